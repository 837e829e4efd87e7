"""Effects of the beds: resistance, compliance, back pressure, autoregulation, hyperaemia, compression."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import ARTERIOLAR, COMPLIANCES, RESISTANCES, Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values

ALL = "all beds"


def _beds_of(place: str, anatomy: Anatomy) -> list[str]:
    """Return the beds of a place: all, those below a vessel, or one."""
    if place == ALL:
        return list(anatomy.beds)
    return anatomy.beds_below(place) if place in anatomy.vessels else [place]


def _groups(anatomy: Anatomy) -> list[str]:
    """Return the places: all beds together, the beds of each coronary artery, and each bed."""
    trees = [vessel for vessel in anatomy.ostia if len(anatomy.beds_below(vessel)) > 1]
    single = list(anatomy.beds)
    if len(single) == 1:
        return [ALL]
    return [ALL, *(trees if len(anatomy.ostia) > 1 else []), *single]


class BedFactor(Effect):
    """Base class of beds with values that differ from the model's by a factor under every condition.

    names: of these values, in beds of all kinds. meaning: of the factor.
    """

    recalibrated = True
    names: ClassVar[tuple[str, ...]]
    meaning: ClassVar[str]

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [bed for bed in anatomy.beds if self._values(anatomy.network, bed)]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        factor = np.exp(np.asarray(sizes["log_factor"], dtype=float))
        return {f"{place}.{name}": value * factor for name, value in self._values(network, place).items()}

    def describe(self, parameter: Parameter, size: float, anatomy: Anatomy) -> tuple[str, float]:
        return self.meaning, float(np.exp(size))

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {self.meaning: float(np.exp(sizes["log_factor"]))}

    def _values(self, network: Network, bed: str) -> dict[str, float]:
        values = network.bed_values(bed)
        return {name: values[name] for name in self.names if values.get(name, 0.0) > 0.0}


class BedResistance(BedFactor):
    """Bed with a far larger or smaller resistance than in the model: microvascular disease, or a wrong value.

    It goes beyond the usual spread of a bed's resistance, which is recalibrated. Rp of an RCR stays, which is that of
    its arteries.
    """

    name = "bed_resistance"
    formula = "R = R_model exp(s) for every resistance of the bed but Rp"
    source = "Camici & Crea, N. Engl. J. Med. 356 (2007) 830 (coronary microvascular dysfunction)"
    signature = "flow into one bed too large or too small by the same factor in every condition"
    native = "Ra, Ram, Rv (Ra1, Ra2, Rv1; Rd; R) of the bed"
    acts_as_source = True
    parameters = (Parameter("log_factor", "1", "normal", 0.0, 1.0, "logarithm of the factor on its resistances"),)
    names, meaning = tuple(name for name in RESISTANCES if name != "Rp"), "factor on its resistances"


class BedCompliance(BedFactor):
    """Bed that stores more or less blood than in the model, beyond the usual spread of its compliance."""

    name = "bed_compliance"
    formula = "C = C_model exp(s) for every compliance of the bed"
    source = "Spaan, Coronary Blood Flow (1991), chapter 6 (intramyocardial compliance)"
    signature = "pulse of the flow into one bed too large or too small, in every condition; its mean is right"
    native = "Ca, Cc (Ca, Cim; C) of the bed"
    acts_as_source = True
    parameters = (Parameter("log_factor", "1", "normal", 0.0, 1.0, "logarithm of the factor on its compliances"),)
    names, meaning = COMPLIANCES, "factor on its compliances"


class BackPressure(Effect):
    """Coronary flow that stops at a pressure above the venous one."""

    name = "back_pressure"
    formula = "Q = (P - P_zf) / R with P_zf above venous pressure"
    source = "Bellamy, Circ. Res. 43 (1978) 92; Spaan, Circ. Res. 56 (1985) 293"
    signature = "flow lower by the same amount at every pressure, which matters most at low pressure"
    native = "P_v of CORONARY, Pd of RCR and RESISTANCE (not expressible in the closed loop)"
    acts_as_source = True
    parameters = (Parameter("pressure", "1", "lognormal", 0.1, 0.8, "added zero-flow pressure over the mean pressure"),)
    names = ("P_v", "Pd")

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [] if anatomy.closed_loop else _groups(anatomy)

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        beds = {bed: network.bed_values(bed) for bed in _beds_of(place, anatomy)}
        return {
            f"{bed}.{name}": values[name] + sizes["pressure"] * anatomy.pressure
            for bed, values in beds.items()
            for name in self.names
            if name in values
        }

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"zero-flow pressure added": sizes["pressure"] * anatomy.pressure}


class Autoregulation(Effect):
    """Arteriolar resistance that rises with pressure, so that flow depends less on pressure.

    The gain is positive: a resistance that falls with pressure is not autoregulation.
    """

    name = "autoregulation"
    formula = "R = R_0 (P / P_0)^g, g > 0, P the mean pressure at the bed, P_0 that of the reference run"
    source = "Mosher et al., Circ. Res. 14 (1964) 250; Johnson, Circ. Res. 59 (1986) 483"
    signature = "flow falls less than pressure between conditions; waveforms within one condition keep their shape"
    native = "Ra, Ram (Ra1, Ra2; Rp, Rd) of the beds, one value per condition, written into the conditions file"
    acts_as_source = True
    parameters = (
        Parameter("gain", "1", "lognormal", 0.6, 0.5, "exponent of pressure in the resistance, 1 if flow is constant"),
    )
    feedback = True

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return _groups(anatomy)

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        changes: Values = {}
        for bed in _beds_of(place, anatomy):
            ratio = np.maximum(condition.bed_pressure[bed] / condition.reference_pressure[bed], 0.05)
            factor = ratio ** np.asarray(sizes["gain"])
            changes |= {f"{bed}.{k}": v * factor for k, v in arteriolar(network, bed).items()}
        return changes


class IncompleteHyperaemia(Effect):
    """Dilatation of the beds that falls short of the nominal effect of the drug."""

    name = "incomplete_hyperaemia"
    formula = (
        "R = R_rest (f + s (1 - f)), f the nominal factor of the condition, s the missing fraction of the dilatation"
    )
    source = "De Bruyne et al., Circulation 107 (2003) 1877"
    signature = "flow too low in conditions that dilate the beds, correct in the others"
    native = "Ra, Ram (Ra1, Ra2; Rp, Rd) of the beds, one value per condition, written into the conditions file"
    acts_as_source = True
    parameters = (Parameter("share", "1", "lognormal", 0.15, 1.0, "missing fraction of the dilatation"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        groups = _groups(anatomy) if anatomy.dilated else []
        return [place for place in groups if not anatomy.dilating.keys().isdisjoint(_beds_of(place, anatomy))]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        nominal = condition.resistance_scale
        if nominal >= 1.0:
            return {}
        factor = (nominal + np.asarray(sizes["share"]) * (1.0 - nominal)) / nominal
        changes: Values = {}
        for bed in (bed for bed in _beds_of(place, anatomy) if bed in anatomy.dilating):
            changes |= {f"{bed}.{k}": v * factor for k, v in arteriolar(network, bed).items()}
        return changes


class CompressedResistance(Effect):
    """Microvascular resistance that rises while the myocardium contracts."""

    name = "compressed_resistance"
    formula = "Ra2(t) = (sqrt(Ra2) (1 + (sqrt(1 + s) - 1) e(t)))^2, e a raised cosine up for T_vc and down for T_vr"
    source = "Spaan, Coronary Blood Flow (1991); the CORONARY_VAR_RES block of svZeroDSolver"
    signature = "systolic flow impeded without the diastolic overshoot that follows the compression of a volume"
    native = "CORONARY_VAR_RES in place of CORONARY (not expressible in the closed loop)"
    acts_as_source = True
    parameters = (
        Parameter("rise", "1", "lognormal", 1.0, 1.0, "systolic over diastolic resistance, minus 1"),
        Parameter("contraction", "1", "lognormal", 0.3, 0.3, "T_vc as a fraction of the cycle"),
        Parameter("relaxation", "1", "lognormal", 0.15, 0.3, "T_vr as a fraction of the cycle"),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [ALL] if self._open_loop_beds(anatomy) else []

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network = super().insert(network, place, anatomy)
        for bed in self._open_loop_beds(anatomy):
            block = network.bed(bed)
            block["bc_type"] = "CORONARY_VAR_RES"
            values = block["bc_values"]
            values["Ra2_min"] = values["Ra2_max"] = values.pop("Ra2")
            values["T_vc"], values["T_vr"] = (one.centre * anatomy.period for one in self.parameters[1:])
        return network

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        changes: Values = {}
        rise = np.asarray(sizes["rise"], dtype=float)
        for bed in self._open_loop_beds(anatomy):
            changes[f"{bed}.Ra2_max"] = network.bed_values(bed)["Ra2_min"] * (1.0 + rise)
            changes[f"{bed}.T_vc"] = np.asarray(sizes["contraction"]) * condition.period
            changes[f"{bed}.T_vr"] = np.asarray(sizes["relaxation"]) * condition.period
        return changes

    @staticmethod
    def _open_loop_beds(anatomy: Anatomy) -> list[str]:
        return [bed for bed in anatomy.beds if anatomy.blocks[bed]["bc_type"] == "CORONARY"]


def arteriolar(network: Network, bed: str) -> dict[str, float]:
    """Return the resistances of a bed that its smooth muscle controls, by name; both of an RCR or RESISTANCE."""
    values = network.bed_values(bed)
    names = [name for name in ARTERIOLAR if name in values] or [name for name in ("Rp", "Rd", "R") if name in values]
    return {name: values[name] for name in names}
