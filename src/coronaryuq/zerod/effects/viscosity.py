"""Viscosity of blood other than assumed."""

import numpy as np

from coronaryuq.zerod.effects.anatomy import RESISTANCES
from coronaryuq.zerod.effects.base import Effect, Parameter, bed_values, vessel_values


class Haematocrit(Effect):
    """A haematocrit, hence viscosity, other than assumed: every viscous resistance scales."""

    name = "haematocrit"
    formula = (
        "R = R_model exp(v), v the logarithm of viscosity over the assumed one; mu ~ exp(2.3 H) between H = 0.3 and 0.5"
    )
    source = "Pries et al., Am. J. Physiol. 263 (1992) H1770"
    signature = "all flows lower at the same pressures and all epicardial losses higher, by one factor"
    native = "R_poiseuille of every vessel and all resistances of every bed"
    parameters = (Parameter("log_viscosity", "1", "normal", 0.0, 0.25, "logarithm of viscosity over the assumed one"),)

    def places(self, anatomy, observed=()):
        return ["everywhere"]

    def changes(self, network, place, sizes, anatomy, condition):
        factor = np.exp(np.asarray(sizes["log_viscosity"]))
        found = {}
        for vessel in anatomy.vessels:
            present = vessel_values(network, vessel).get("R_poiseuille", 0.0)
            if present > 0.0:
                found[f"{vessel}.R_poiseuille"] = present * factor
        for bed in anatomy.blocks:
            values = bed_values(network, bed)
            found |= {f"{bed}.{name}": values[name] * factor for name in RESISTANCES if name in values}
        return found

    def physical(self, place, sizes, anatomy):
        return {
            "viscosity over the model's": float(np.exp(sizes["log_viscosity"])),
            "haematocrit change": sizes["log_viscosity"] / 2.3,
        }
