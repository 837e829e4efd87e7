"""Kinetic energy of the blood at a probe, which a lumped network does not convert to and from pressure."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.core import units
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Channel, Effect, Parameter, Series, Values
from coronaryuq.zerod.effects.sensors import NATIVE

AT_PROBES, AT_DRIVE = "the probes", "the driving pressure"


class DynamicPressure(Effect):
    """Static pressure at the probes, where the network's pressures are total ones.

    Without losses, total pressure stays the same from a wide vessel to a narrow one, in which blood flows faster, while
    static pressure falls. It is not in the library, because every real vessel has it: a search takes it as an error
    that any prediction has. Places: the probes; the inlet, if it is driven by a pressure, which is static as well.

    Formula: P_read = P - s rho (Q / A)^2 / 2 at probes, P + s rho (Q_in / A_in)^2 / 2 for the inlet

    density: of blood in the network's units of pressure, that in g/cm3 if these are dyn/cm2.
    """

    name = "dynamic_pressure"
    side = "measurement"
    native = NATIVE
    nameable = False
    parameters = (Parameter("share", "1", "normal", 0.0, 1.0, "0 as in the model, 1 for a flat velocity profile"),)

    def __init__(self, density: float = units.BLOOD_DENSITY):
        self.density = density

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [AT_PROBES, AT_DRIVE] if any(_driven(anatomy, root) for root in anatomy.roots) else [AT_PROBES]

    def elsewhere(self, place: str, series: Series, anatomy: Anatomy) -> Channel | None:
        vessel = anatomy.vessel_at(series.location)
        if vessel is None or series.quantity not in ("pressure", "ratio"):
            return None
        root = anatomy.root_of(vessel)
        if _driven(anatomy, root) and series.location == anatomy.inlet(root):
            return None
        if place == AT_DRIVE:
            return ("flow", anatomy.inlet(root)) if _driven(anatomy, root) else None
        return "flow", series.location

    def read(
        self,
        place: str,
        sizes: Values,
        series: Series,
        wave: np.ndarray,
        other: np.ndarray | None,
        anatomy: Anatomy,
    ) -> np.ndarray:
        found = self.elsewhere(place, series, anatomy)
        vessel = None if found is None else anatomy.vessel_at(found[1])
        area = 0.0 if vessel is None else self._area(vessel, anatomy)
        if other is None or area == 0.0:
            return wave
        share = np.asarray(sizes["share"], dtype=float)[:, None] * (1.0 if place == AT_DRIVE else -1.0)
        return wave + share * self.density * (other / area) ** 2 / 2.0

    def _area(self, vessel: str, anatomy: Anatomy) -> float:
        """Return the area (cm2) that the inertance of a vessel implies, or its resistance if that is larger; or 0.

        A stenosis that is part of the resistance makes that of Poiseuille's law too small.
        """
        values, length = anatomy.vessels[vessel]["zero_d_element_values"], anatomy.length(vessel)
        inertance, resistance = values.get("L", 0.0), values.get("R_poiseuille", 0.0)
        viscosity = units.BLOOD_VISCOSITY * self.density / units.BLOOD_DENSITY
        areas = [0.0, self.density * length / inertance if inertance > 0.0 else 0.0]
        areas.append(float(np.sqrt(8.0 * np.pi * viscosity * length / resistance)) if resistance > 0.0 else 0.0)
        return max(areas)


def _driven(anatomy: Anatomy, root: str) -> bool:
    """Whether the pressure at an inlet is given."""
    bed = anatomy.inlet_bc.get(root)
    return bed is not None and anatomy.kind(bed) == "PRESSURE"
