"""Blood viscosity that differs from the assumed one."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.blood import viscosity_of
from coronaryuq.zerod.effects.anatomy import RESISTANCES, Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values

PER_HAEMATOCRIT = np.log(viscosity_of(0.5) / viscosity_of(0.3)) / 0.2
"""Mean slope of the logarithm of viscosity between haematocrits of 0.3 and 0.5."""


class Haematocrit(Effect):
    """Haematocrit, and hence viscosity, that differs from the assumed one and scales every viscous resistance."""

    name = "haematocrit"
    formula = (
        "R = R_model exp(v), v the logarithm of viscosity over the assumed one; mu ~ exp(2.6 H) between H = 0.3 and 0.5"
    )
    source = "Pries et al., Am. J. Physiol. 263 (1992) H1770"
    signature = "all flows lower at the same pressures and all epicardial losses higher, by one factor"
    native = "R_poiseuille of every vessel and all resistances of every bed"
    parameters = (Parameter("log_viscosity", "1", "normal", 0.0, 0.25, "logarithm of viscosity over the assumed one"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return ["everywhere"]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        factor = np.exp(np.asarray(sizes["log_viscosity"]))
        changes: Values = {}
        for vessel in anatomy.vessels:
            present = network.vessel_values(vessel).get("R_poiseuille", 0.0)
            if present > 0.0:
                changes[f"{vessel}.R_poiseuille"] = present * factor
        for bed in anatomy.blocks:
            values = network.bed_values(bed)
            changes |= {f"{bed}.{name}": values[name] * factor for name in RESISTANCES if name in values}
        return changes

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {
            "viscosity over the model's": float(np.exp(sizes["log_viscosity"])),
            "haematocrit change": sizes["log_viscosity"] / PER_HAEMATOCRIT,
        }
