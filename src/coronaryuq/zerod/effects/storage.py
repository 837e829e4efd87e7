"""Storage and inertia of epicardial vessels."""

from coronaryuq.zerod.effects.base import Effect, Parameter, vessel_values


class EpicardialCompliance(Effect):
    """Blood stored in the wall's expansion of an epicardial vessel."""

    name = "epicardial_compliance"
    formula = "Q_in - Q_out = C dP/dt"
    source = "Westerhof, Stergiopulos & Noble, Snapshots of Hemodynamics (2nd ed., 2010)"
    signature = "inflow leads outflow during the rise of pressure: high-frequency, without a change of means"
    native = "C of the vessel"
    parameters = (
        Parameter(
            "storage",
            "1",
            "lognormal",
            0.02,
            1.2,
            "volume stored by the mean pressure over the volume that passes in a cycle",
        ),
    )
    element = "C"

    def places(self, anatomy, observed=()):
        return anatomy.coronary_vessels

    def changes(self, network, place, sizes, anatomy, condition):
        present = vessel_values(network, place).get(self.element, 0.0)
        return {f"{place}.{self.element}": present + self._added(place, sizes, anatomy)}

    def physical(self, place, sizes, anatomy):
        return {f"{self.element} added": self._added(place, sizes, anatomy)}

    def _added(self, place, sizes, anatomy):
        return sizes["storage"] * anatomy.flow_scale(place) * anatomy.period / anatomy.pressure


class Inertance(EpicardialCompliance):
    """Inertia of the blood column in an epicardial vessel."""

    name = "inertance"
    formula = "P_in - P_out = L dQ/dt"
    source = "Milnor, Hemodynamics (2nd ed., 1989), chapter 2: L = rho l / A"
    signature = "flow lags pressure; sharp changes of flow are rounded, means are unchanged"
    native = "L of the vessel"
    # A coronary artery of 3 mm and 5 cm at 1 mL/s has 7e-4, which usual noise hides: the prior is about what is seen,
    # as of a cannula or of a vessel that the model lacks, and reaches down to that.
    parameters = (
        Parameter(
            "inertia",
            "1",
            "lognormal",
            0.01,
            1.2,
            "pressure that turns the mean flow on within one cycle over the mean pressure",
        ),
    )
    element = "L"

    def _added(self, place, sizes, anatomy):
        return sizes["inertia"] * anatomy.pressure * anatomy.period / anatomy.flow_scale(place)
