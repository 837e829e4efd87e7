"""Compression of the intramyocardial vessels by the beating heart."""

import numpy as np

from coronaryuq.zerod.effects.base import WAVE_POINTS, Effect, Parameter, sampled

EJECTION = 0.35
"""Systole's share of the cycle where no ventricular pressure was measured (Weissler, Circulation 37 (1968) 149)."""
SYSTOLIC = 1.25
"""Systolic ventricular pressure over the mean aortic one."""
PULSING = 1e-3
"""Swing of an intramyocardial pressure over the mean pressure, above which it has a shape."""


class IntramyocardialPressure(Effect):
    """Intramyocardial pressure that the model lacks or has too little of: a share of left ventricular pressure."""

    name = "intramyocardial_pressure"
    formula = "P_im(t) = P_im,model(t) + s P_LV(t)"
    source = "Spaan et al., Circ. Res. 49 (1981) 584; Kim et al., Ann. Biomed. Eng. 38 (2010) 3195"
    signature = "flow impeded in systole and released in early diastole, with little change of the mean"
    native = "Pim of open-loop CORONARY blocks; iml and imr of the closed-loop heart"
    parameters = (Parameter("share", "1", "normal", 0.0, 0.75, "share of left ventricular pressure that is added"),)

    def places(self, anatomy, observed=()):
        if anatomy.closed_loop:
            kinds = {anatomy.blocks[bed]["bc_type"] for bed in anatomy.beds}
            return [
                side
                for side, kind in (("left", "ClosedLoopCoronaryLeft"), ("right", "ClosedLoopCoronaryRight"))
                if kind in kinds
            ]
        return ["all beds"] if _open_beds(anatomy) else []

    def changes(self, network, place, sizes, anatomy, condition):
        share = np.asarray(sizes["share"], dtype=float)
        if anatomy.closed_loop:
            name = "iml" if place == "left" else "imr"
            return {f"CLH.{name}": network["closed_loop_blocks"][0]["parameters"][name] * np.exp(share)}
        found = {}
        for bed in _open_beds(anatomy):
            time, present = waveform(network, bed, condition.period)
            pressure = ventricular_pressure(time, anatomy, condition, present)
            found[f"{bed}.Pim"] = present + share[:, None] * pressure
        return found

    def said(self, parameter, size, anatomy):
        if anatomy.closed_loop:
            return "factor on the model's intramyocardial pressure", float(np.exp(size))
        return super().said(parameter, size, anatomy)

    def assumed(self, anatomy, covariates):
        if anatomy.closed_loop or all("LV" in one for one in covariates):
            return ""
        beds = [anatomy.blocks[bed]["bc_values"]["Pim"] for bed in _open_beds(anatomy)]
        pulsing = all(np.ptp(pressure) > PULSING * anatomy.pressure for pressure in beds)
        shape = "the model's own compression" if pulsing else f"a half sine over {EJECTION:.0%} of the beat"
        return f"Left ventricular pressure is not given (drive LV): {shape} stands for its shape. "

    def physical(self, place, sizes, anatomy):
        if anatomy.closed_loop:
            return {"factor of the intramyocardial pressure": float(np.exp(sizes["share"]))}
        return dict(sizes)


class IntramyocardialDelay(Effect):
    """Intramyocardial pressure that comes later (or earlier) than the model has it."""

    name = "intramyocardial_delay"
    formula = "P_im(t) = P_im,model(t - d T)"
    source = "Spaan et al., Circ. Res. 49 (1981) 584"
    signature = "the systolic dip of flow is shifted in time, its depth unchanged"
    native = "Pim of open-loop CORONARY blocks (not expressible in the closed-loop heart)"
    turning = True
    parameters = (Parameter("delay", "cycle", "normal", 0.0, 0.05, "delay over the period"),)

    def places(self, anatomy, observed=()):
        if anatomy.closed_loop:
            return []
        swings = [np.ptp(anatomy.blocks[bed]["bc_values"]["Pim"]) for bed in _open_beds(anatomy)]
        return ["all beds"] if any(swing > PULSING * anatomy.pressure for swing in swings) else []

    def changes(self, network, place, sizes, anatomy, condition):
        found = {}
        for bed in _open_beds(anatomy):
            time, present = waveform(network, bed, condition.period)
            shifted = (time[None, :] - np.asarray(sizes["delay"])[:, None] * condition.period) % condition.period
            found[f"{bed}.Pim"] = np.interp(shifted, time, present)
        return found


def _open_beds(anatomy):
    return [bed for bed in anatomy.beds if "Pim" in anatomy.blocks[bed]["bc_values"]]


def waveform(network: dict, bed: str, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Intramyocardial pressure of a bed over one cycle, on an even grid."""
    return np.linspace(0.0, period, WAVE_POINTS), sampled(network, f"{bed}.Pim")


def ventricular_pressure(time: np.ndarray, anatomy, condition, compression: np.ndarray = 0.0) -> np.ndarray:
    """Left ventricular pressure at `time` (k,): the measured one where there is one.

    Else it pulses as the model's own intramyocardial pressure `compression` (k,) does, and where that is constant as a
    half sine over systole, `EJECTION` long. Either reaches 1.25 times the model's mean pressure, a usual systolic over
    mean.
    """
    if "LV" in condition.covariates:
        own, pressure = condition.covariates["LV"]
        return np.interp(time / condition.period * own[-1], own, pressure, period=own[-1])
    swing = np.ptp(compression)
    if swing > PULSING * anatomy.pressure:
        return SYSTOLIC * anatomy.pressure * (compression - np.min(compression)) / swing
    phase = (time / condition.period) % 1.0
    return np.where(phase < EJECTION, SYSTOLIC * anatomy.pressure * np.sin(np.pi * phase / EJECTION), 0.0)
