"""What a bed does that fixed resistances do not: back pressure, autoregulation, incomplete hyperaemia, compression."""

import numpy as np

from coronaryuq.zerod.effects.anatomy import ARTERIOLAR
from coronaryuq.zerod.effects.base import Effect, Parameter, bed_values

ALL = "all beds"


def _chosen(place: str, anatomy) -> list[str]:
    """Beds that a place stands for: all, those below a vessel, or one."""
    if place == ALL:
        return list(anatomy.beds)
    return anatomy.beds_below(place) if place in anatomy.vessels else [place]


def _groups(anatomy) -> list[str]:
    """All beds together, the beds of each coronary artery, and each bed."""
    trees = [vessel for vessel in anatomy.ostia if len(anatomy.beds_below(vessel)) > 1]
    single = list(anatomy.beds)
    if len(single) == 1:
        return [ALL]
    return [ALL, *(trees if len(anatomy.ostia) > 1 else []), *single]


class BackPressure(Effect):
    """Flow stops at a pressure above the venous one."""

    name = "back_pressure"
    formula = "Q = (P - P_zf) / R with P_zf above venous pressure"
    source = "Bellamy, Circ. Res. 43 (1978) 92; Spaan, Circ. Res. 56 (1985) 293"
    signature = (
        "flow lower than pressure over resistance, by the same amount at every pressure: most of it at low pressure"
    )
    native = "P_v of CORONARY, Pd of RCR and RESISTANCE (not expressible in the closed loop)"
    parameters = (
        Parameter("pressure", "1", "lognormal", 0.1, 0.8, "zero-flow pressure that is added, over the mean pressure"),
    )
    names = ("P_v", "Pd")

    def places(self, anatomy, observed=()):
        return [] if anatomy.closed_loop else _groups(anatomy)

    def changes(self, network, place, sizes, anatomy, condition):
        found = {}
        for bed in _chosen(place, anatomy):
            values = bed_values(network, bed)
            for name in self.names:
                if name in values:
                    found[f"{bed}.{name}"] = values[name] + sizes["pressure"] * anatomy.pressure
        return found

    def physical(self, place, sizes, anatomy):
        return {"zero-flow pressure added": sizes["pressure"] * anatomy.pressure}


class Autoregulation(Effect):
    """Arteriolar resistance that follows pressure, so that flow depends less on it."""

    name = "autoregulation"
    formula = "R = R_0 (P / P_0)^g, P the mean pressure at the bed, P_0 that of the model as it is"
    source = "Mosher et al., Circ. Res. 14 (1964) 250; Johnson, Circ. Res. 59 (1986) 483"
    signature = "flow falls less than pressure between conditions; waveforms within one condition keep their shape"
    native = "Ra, Ram (Ra1, Ra2; Rp, Rd) of the beds, one value per condition, written into the conditions file"
    parameters = (
        Parameter("gain", "1", "normal", 0.0, 0.5, "exponent of pressure in resistance; 1 keeps flow constant"),
    )
    feedback = True

    def places(self, anatomy, observed=()):
        return _groups(anatomy)

    def changes(self, network, place, sizes, anatomy, condition):
        found = {}
        for bed in _chosen(place, anatomy):
            ratio = np.maximum(condition.pressure[bed] / condition.resting[bed], 0.05)
            factor = ratio ** np.asarray(sizes["gain"])
            found |= {f"{bed}.{k}": v * factor for k, v in arteriolar(network, bed).items()}
        return found


class IncompleteHyperaemia(Effect):
    """Beds that dilate less than the drug's nominal effect."""

    name = "incomplete_hyperaemia"
    formula = (
        "R = R_rest (f + s (1 - f)), f the nominal factor of the condition, s the share of dilatation that stays out, "
        "all of it at most"
    )
    source = "De Bruyne et al., Circulation 107 (2003) 1877"
    signature = "flow too low where the condition dilates, right where it does not"
    native = "Ra, Ram (Ra1, Ra2; Rp, Rd) of the beds, one value per condition, written into the conditions file"
    parameters = (Parameter("share", "1", "lognormal", 0.15, 1.0, "share of the dilatation that stays out"),)

    def places(self, anatomy, observed=()):
        return _groups(anatomy)

    def changes(self, network, place, sizes, anatomy, condition):
        nominal = condition.vasodilated
        if nominal >= 1.0:
            return {}
        # Beyond all of it a bed would be tighter than at rest.
        share = np.minimum(np.asarray(sizes["share"]), 1.0)
        factor = (nominal + share * (1.0 - nominal)) / nominal
        found = {}
        for bed in _chosen(place, anatomy):
            found |= {f"{bed}.{k}": v * factor for k, v in arteriolar(network, bed).items()}
        return found


class CompressedResistance(Effect):
    """Microvascular resistance that rises while the muscle contracts."""

    name = "compressed_resistance"
    formula = "Ra2(t) = (sqrt(Ra2) (1 + (sqrt(1 + s) - 1) e(t)))^2, e a raised cosine up for T_vc and down for T_vr"
    source = "Spaan, Coronary Blood Flow (1991); the CORONARY_VAR_RES block of svZeroDSolver"
    signature = "systolic flow impeded without the diastolic overshoot that a compressed volume gives back"
    native = "CORONARY_VAR_RES in place of CORONARY (not expressible in the closed loop)"
    parameters = (Parameter("rise", "1", "lognormal", 1.0, 1.0, "systolic resistance over the diastolic one, less 1"),)
    contraction, relaxation = 0.3, 0.15

    def places(self, anatomy, observed=()):
        return [ALL] if self._suited(anatomy) else []

    def insert(self, network, place, anatomy):
        network = super().insert(network, place, anatomy)
        for bed in self._suited(anatomy):
            block = next(b for b in network["boundary_conditions"] if b["bc_name"] == bed)
            block["bc_type"] = "CORONARY_VAR_RES"
            values = block["bc_values"]
            values["Ra2_min"] = values["Ra2_max"] = values.pop("Ra2")
            values["T_vc"], values["T_vr"] = self.contraction * anatomy.period, self.relaxation * anatomy.period
        return network

    def changes(self, network, place, sizes, anatomy, condition):
        found = {}
        rise = np.asarray(sizes["rise"], dtype=float)
        for bed in self._suited(anatomy):
            found[f"{bed}.Ra2_max"] = bed_values(network, bed)["Ra2_min"] * (1.0 + rise)
            found[f"{bed}.T_vc"] = np.full(rise.shape, self.contraction * condition.period)
            found[f"{bed}.T_vr"] = np.full(rise.shape, self.relaxation * condition.period)
        return found

    @staticmethod
    def _suited(anatomy):
        return [bed for bed in anatomy.beds if anatomy.blocks[bed]["bc_type"] == "CORONARY"]


def arteriolar(network: dict, bed: str) -> dict[str, float]:
    """Resistances of a bed that its smooth muscle sets, by name; both of an RCR or RESISTANCE."""
    values = bed_values(network, bed)
    names = [name for name in ARTERIOLAR if name in values] or [name for name in ("Rp", "Rd", "R") if name in values]
    return {name: values[name] for name in names}
