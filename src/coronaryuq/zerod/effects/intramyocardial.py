"""Compression of the intramyocardial vessels by the contracting heart."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.units import percent
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values
from coronaryuq.zerod.effects.beds import ALL
from coronaryuq.zerod.network.waveforms import WAVE_POINTS, sampled

EJECTION = 0.35
"""Duration of systole over the cycle if no ventricular pressure is measured (Weissler, Circulation 37 (1968) 149)."""
SYSTOLIC = 1.25
"""Systolic ventricular pressure over the mean aortic pressure."""
PULSING = 1e-3
"""Pulse of an intramyocardial pressure over the mean pressure above which its waveform is used."""


class IntramyocardialPressure(Effect):
    """Intramyocardial pressure missing from the model: an added fraction of the left ventricular pressure."""

    name = "intramyocardial_pressure"
    formula = "P_im(t) = P_im,model(t) + s P_LV(t)"
    source = "Spaan et al., Circ. Res. 49 (1981) 584; Kim et al., Ann. Biomed. Eng. 38 (2010) 3195"
    signature = "flow impeded in systole and released in early diastole, with little change of its mean"
    native = "Pim of open-loop CORONARY blocks; iml and imr of the closed-loop heart"
    parameters = (Parameter("share", "1", "normal", 0.0, 0.75, "added fraction of the left ventricular pressure"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        if anatomy.closed_loop:
            kinds = {anatomy.blocks[bed]["bc_type"] for bed in anatomy.beds}
            return [
                side
                for side, kind in (("left", "ClosedLoopCoronaryLeft"), ("right", "ClosedLoopCoronaryRight"))
                if kind in kinds
            ]
        return [ALL] if _open_beds(anatomy) else []

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        share = np.asarray(sizes["share"], dtype=float)
        if anatomy.closed_loop:
            name = "iml" if place == "left" else "imr"
            return {f"CLH.{name}": network.heart["parameters"][name] * np.exp(share)}
        changes: Values = {}
        for bed in _open_beds(anatomy):
            time, present = waveform(network, bed, condition.period)
            pressure = ventricular_pressure(time, anatomy, condition, present)
            changes[f"{bed}.Pim"] = present + share[:, None] * pressure
        return changes

    def describe(self, parameter: Parameter, size: float, anatomy: Anatomy) -> tuple[str, float]:
        if anatomy.closed_loop:
            return "factor on the model's intramyocardial pressure", float(np.exp(size))
        return super().describe(parameter, size, anatomy)

    def assumption(self, anatomy: Anatomy, covariates: list[dict]) -> str:
        if anatomy.closed_loop or all("LV" in waveforms for waveforms in covariates):
            return ""
        pulsing = all(_pulses(anatomy, bed) for bed in _open_beds(anatomy))
        shape = (
            "the model's intramyocardial pressure" if pulsing else f"a half sine over {percent(EJECTION)} of the beat"
        )
        return f"Left ventricular pressure is not given (drive LV): its shape is assumed to be {shape}. "

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        if anatomy.closed_loop:
            return {"factor of the intramyocardial pressure": float(np.exp(sizes["share"]))}
        return dict(sizes)


class IntramyocardialDelay(Effect):
    """Intramyocardial pressure that is later (or earlier) than in the model."""

    name = "intramyocardial_delay"
    formula = "P_im(t) = P_im,model(t - d T)"
    source = "Spaan et al., Circ. Res. 49 (1981) 584"
    signature = "systolic dip of the flow shifted in time, its depth unchanged"
    native = "Pim of open-loop CORONARY blocks (not expressible in the closed-loop heart)"
    changes_shape = True
    parameters = (Parameter("delay", "cycle", "normal", 0.0, 0.05, "delay over the period"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        if anatomy.closed_loop:
            return []
        return [ALL] if any(_pulses(anatomy, bed) for bed in _open_beds(anatomy)) else []

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        changes: Values = {}
        for bed in _open_beds(anatomy):
            time, present = waveform(network, bed, condition.period)
            shifted = (time[None, :] - np.asarray(sizes["delay"])[:, None] * condition.period) % condition.period
            changes[f"{bed}.Pim"] = np.interp(shifted, time, present)
        return changes


def _open_beds(anatomy: Anatomy) -> list[str]:
    return [bed for bed in anatomy.beds if "Pim" in anatomy.blocks[bed]["bc_values"]]


def _pulses(anatomy: Anatomy, bed: str) -> bool:
    """Whether the intramyocardial pressure of a bed has a waveform, in the network or under a condition."""
    return bed in anatomy.driven or np.ptp(anatomy.blocks[bed]["bc_values"]["Pim"]) > PULSING * anatomy.pressure


def waveform(network: Network, bed: str, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and intramyocardial pressure of a bed over one cycle, (WAVE_POINTS,) each."""
    return np.linspace(0.0, period, WAVE_POINTS), sampled(network, f"{bed}.Pim")


def ventricular_pressure(
    time: np.ndarray, anatomy: Anatomy, condition: ConditionState, compression: np.ndarray
) -> np.ndarray:
    """Return the left ventricular pressure at `time` (k,), measured if available.

    Otherwise it has the shape of the model's intramyocardial pressure `compression` (k,) or, if that is constant, of a
    half sine over systole. Either peaks at `SYSTOLIC` times the model's mean pressure.
    """
    if "LV" in condition.covariates:
        measured_time, pressure = condition.covariates["LV"]
        length = measured_time[-1]
        return np.interp(time / condition.period * length, measured_time, pressure, period=length)
    pulse = np.ptp(compression)
    if pulse > PULSING * anatomy.pressure:
        return SYSTOLIC * anatomy.pressure * (compression - np.min(compression)) / pulse
    phase = (time / condition.period) % 1.0
    return np.where(phase < EJECTION, SYSTOLIC * anatomy.pressure * np.sin(np.pi * phase / EJECTION), 0.0)
