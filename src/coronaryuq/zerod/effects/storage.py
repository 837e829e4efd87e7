"""Storage and inertia of epicardial vessels."""

from collections.abc import Mapping, Sequence

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Series, Values


class EpicardialCompliance(Effect):
    """Blood stored by the expansion of an epicardial vessel."""

    name = "epicardial_compliance"
    formula = "Q_in - Q_out = C dP/dt"
    source = "Westerhof, Stergiopulos & Noble, Snapshots of Hemodynamics (2nd ed., 2010)"
    signature = "inflow leads outflow while pressure rises; affects high frequencies, not the means"
    native = "C of the vessel"
    acts_as_source = True
    parameters = (
        Parameter(
            "storage",
            "1",
            "lognormal",
            0.02,
            1.2,
            "volume stored at the mean pressure over the volume that passes in a cycle",
        ),
    )
    element = "C"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.coronary_vessels

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        present = network.vessel_values(place).get(self.element, 0.0)
        return {f"{place}.{self.element}": present + self._added(place, sizes, anatomy)}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {f"{self.element} added": self._added(place, sizes, anatomy)}

    def _added(self, place: str, sizes: Mapping[str, Number], anatomy: Anatomy) -> Number:
        return sizes["storage"] * anatomy.flow_scale(place) * anatomy.period / anatomy.pressure


class ViscoelasticWall(Effect):
    """Viscous wall of a vessel that stores blood (Kelvin-Voigt): a resistance in series with its compliance."""

    name = "viscoelastic_wall"
    formula = "P = V / C + R_w dV/dt, R_w = tau / C, with dV/dt = Q_in - Q_out"
    source = "Armentano et al., Circ. Res. 76 (1995) 468; Alastruey et al., J. Biomech. 44 (2011) 2250"
    signature = (
        "a vessel that stores blood stiffens towards high frequencies: less damping of steep changes, same means"
    )
    native = "R_wall of BloodVessel, our extension of the format that svZeroDSolver does not support"
    acts_as_source = True
    parameters = (Parameter("time_constant", "s", "lognormal", 0.015, 0.5, "time constant R_w C in seconds"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        vessels = {name: anatomy.vessels[name] for name in anatomy.coronary_vessels}
        return [
            name
            for name, vessel in vessels.items()
            if vessel["zero_d_element_type"] == "BloodVessel" and vessel["zero_d_element_values"].get("C", 0.0) > 0.0
        ]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        present = network.vessel_values(place).get("R_wall", 0.0)
        return {f"{place}.R_wall": present + self._resistance(place, sizes["time_constant"], anatomy)}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"R_wall added": self._resistance(place, sizes["time_constant"], anatomy)}

    @staticmethod
    def _resistance(place: str, time_constant: Number, anatomy: Anatomy) -> Number:
        return time_constant / anatomy.vessels[place]["zero_d_element_values"]["C"]


class Inertance(EpicardialCompliance):
    """Inertia of the blood column in an epicardial vessel."""

    name = "inertance"
    formula = "P_in - P_out = L dQ/dt"
    source = "Milnor, Hemodynamics (2nd ed., 1989), chapter 2: L = rho l / A"
    signature = "flow lags pressure; sharp changes of flow are smoothed, means are unchanged"
    native = "L of the vessel"
    # A coronary artery of 3 mm and 5 cm at 1 mL/s has 7e-4, which typical noise hides. The prior covers detectable
    # values, as of a cannula or of a vessel missing from the model, and extends down to that value.
    acts_as_source = False
    parameters = (
        Parameter(
            "inertia",
            "1",
            "lognormal",
            0.01,
            1.2,
            "pressure that accelerates the blood to its mean flow within one cycle, over the mean pressure",
        ),
    )
    element = "L"

    def _added(self, place: str, sizes: Mapping[str, Number], anatomy: Anatomy) -> Number:
        return sizes["inertia"] * anatomy.pressure * anatomy.period / anatomy.flow_scale(place)
