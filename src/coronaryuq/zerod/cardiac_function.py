"""Clinical and literature measures of cardiac function, computed from the waveforms of a closed loop.

The names are those of the public svZeroDEstimator's target files (Menon et al. 2023, 2024; Tran et al. 2017), so that
such a file can be read unchanged. Each is a number per sample of a batch, in the units of the network.

Systole is the interval in which the aortic valve passes flow: from the peak of aortic valve flow outwards to where it
falls below `VALVE_OPEN` of the peak for longer than a flutter, crossing times interpolated linearly, so that a
measure changes smoothly with the parameters and little with the time step. Diastole is the rest of the cycle.
"""

from collections.abc import Mapping

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology

VALVE_OPEN = 0.01
"""A valve counts as open while its flow exceeds this fraction of its peak."""

CLOSURE = 0.1
"""Fraction of a cycle after valve closure that is left out of the diastolic maximum: the closing transient."""

FLUTTER = 0.06
"""Fraction of a cycle: a valve that closes for less, and opens again, counts as open (it flutters in the 0D model)."""

REOPENED = 0.15
"""Fraction of the peak flow above which a second opening is part of the same systole; less is the valve's recoil."""

PROMINENCE = 0.02
"""A turning point of a coronary flow waveform counts if it stands out by this fraction of the waveform's range."""

MEASURES = (
    "PaoMin", "PaoMax", "PaoMean", "AorCorSplit", "AbsQin", "Qsystole_perc", "PpulMean", "EFLV", "ESV", "EDV",
    "QlaRatio", "mitValveTime", "aorValveTime", "pulValveTime", "PraMean", "LCorMaxRatio", "LCorTotRatio", "LThirdFF",
    "LHalfFF", "LGradOK", "RCorMaxRatio", "RCorTotRatio", "RThirdFF", "RHalfFF", "RGradOK",
)  # fmt: skip


def waveform_names(network: Network) -> dict[str, list[str]]:
    """Return the 0D names of each role, as svZeroDSolver writes them; a role's waveform is the sum over its names.

    Roles: `aortic_pressure`, `aortic_flow`, `right_atrial_pressure`, `pulmonary_pressure`, `lv_volume`, `aortic_valve`,
    `mitral_valve`, `pulmonary_valve`, `left_coronary`, `right_coronary` and `systemic`. The coronary roles sum the
    flow that enters the beds of that type (ClosedLoopCoronaryLeft, ClosedLoopCoronaryRight), `systemic` that of the
    closed-loop RCRs.
    """
    topology, outlets = Topology(network), network.heart["outlet_blocks"]
    roles = {
        "aortic_pressure": [f"pressure:J_heart_outlet:{outlets[0]}"],
        "aortic_flow": [f"flow:J_heart_outlet:{outlet}" for outlet in outlets],
        "right_atrial_pressure": ["pressure:J_heart_inlet:CLH"],
        "pulmonary_pressure": ["P_pul:CLH"],
        "lv_volume": ["V_LV:CLH"],
        "aortic_valve": ["Q_LV:CLH"],
        "mitral_valve": ["Q_LA:CLH"],
        "pulmonary_valve": ["Q_RV:CLH"],
    }
    for role, kind in (("left_coronary", "ClosedLoopCoronaryLeft"), ("right_coronary", "ClosedLoopCoronaryRight"),
                       ("systemic", "ClosedLoopRCR")):  # fmt: skip
        ends = [topology.vessel_of.get(bed) for bed in topology.blocks if topology.kind(bed) == kind]
        roles[role] = [f"flow:{topology.outlet(vessel)}" for vessel in ends if vessel is not None]
    return roles


def measure(time: np.ndarray, waves: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Compute all `MEASURES` of a batch.

    Parameters
    ----------
    time : array (m+1,)
        Times over one period, s.
    waves : mapping of str to array (n, m+1)
        Waveforms by the roles of `waveform_names`.

    Returns
    -------
    dict of str to array (n,)
        Pressures and volumes in the network's units. `AbsQin`: stroke volume that leaves through the aorta.
        `AorCorSplit`: coronary flow in per cent of all flow that enters the beds. `...FF`: fraction of a coronary
        artery's flow in the third and half of a cycle that follow aortic valve closure. `...GradOK`: see
        `turning_points`. A measure that does not exist (a valve that never opens, no right coronary bed) is NaN.
    """
    time = np.asarray(time, float)
    n = len(waves["aortic_pressure"])
    values = {name: np.full(n, np.nan) for name in MEASURES}
    period = time[-1] - time[0]
    step = np.diff(time) / period

    def mean(wave):
        # No matrix product: its order of summation, and so its rounding, would depend on the size of the batch.
        return (0.5 * (wave[:, 1:] + wave[:, :-1]) * step).sum(axis=1)

    pressure, volume = waves["aortic_pressure"], waves["lv_volume"]
    values["PaoMin"], values["PaoMax"], values["PaoMean"] = pressure.min(1), pressure.max(1), mean(pressure)
    values["EDV"], values["ESV"] = volume.max(1), volume.min(1)
    values["EFLV"] = (values["EDV"] - values["ESV"]) / values["EDV"]
    values["AbsQin"] = np.abs(mean(waves["aortic_flow"])) * period
    values["PpulMean"], values["PraMean"] = mean(waves["pulmonary_pressure"]), mean(waves["right_atrial_pressure"])
    coronary = mean(waves["left_coronary"]) + mean(waves["right_coronary"])
    values["AorCorSplit"] = 100.0 * coronary / (coronary + mean(waves["systemic"]))
    for sample in range(n):
        of_sample = {role: wave[sample] for role, wave in waves.items()}
        for name, value in _timing(time, of_sample).items():
            values[name][sample] = value
    return values


def _timing(time: np.ndarray, waves: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Compute the measures of one sample that need the valves' opening and closing times."""
    period = time[-1] - time[0]
    values = {}
    for name, role in (("mitValveTime", "mitral_valve"), ("pulValveTime", "pulmonary_valve")):
        values[name] = _open_fraction(time, waves[role])
    systole = open_interval(time, waves["aortic_valve"])
    if systole is None:
        return values
    start, end = systole
    values["aorValveTime"] = (end - start) / period
    flow = _Cyclic(time, waves["aortic_flow"])
    values["Qsystole_perc"] = flow.integral(start, end) / flow.integral(start, start + period)
    values["QlaRatio"] = _early_over_late(time, waves["mitral_valve"], end, start + period)
    for side, role in (("L", "left_coronary"), ("R", "right_coronary")):
        flow = _Cyclic(time, waves[role])
        total = flow.integral(start, start + period)
        if not total > 0.0:
            continue
        systolic = flow.integral(start, end)
        values[f"{side}CorTotRatio"] = (total - systolic) / systolic
        values[f"{side}CorMaxRatio"] = flow.maximum(end + CLOSURE * period, start + period) / flow.maximum(start, end)
        values[f"{side}ThirdFF"] = flow.integral(end, end + period / 3.0) / total
        values[f"{side}HalfFF"] = flow.integral(end, end + period / 2.0) / total
        values[f"{side}GradOK"] = turning_points(waves[role])
    return values


def open_interval(time: np.ndarray, flow: np.ndarray) -> tuple[float, float] | None:
    """Return the times (s) around its peak between which a valve's flow (m+1,) exceeds `VALVE_OPEN` of that peak.

    The end may lie past the period. None if the valve never passes flow or never closes.
    """
    peak = int(np.argmax(flow[:-1]))
    level = VALVE_OPEN * flow[peak]
    cycle, period = len(time) - 1, time[-1] - time[0]
    if not flow[peak] > 0.0 or flow.min() >= level:
        return None
    around = np.roll(flow[:-1], -peak)
    forward, backward = _shut(around, level), _shut(around[::-1], level) + 1
    after = _crossing(time, flow, peak + forward - 1, level, cycle)
    before = _crossing(time, flow, peak - backward, level, cycle)
    while before < time[0]:
        before, after = before + period, after + period
    return before, after


def _shut(flow: np.ndarray, level: float) -> int:
    """Return the index from which the flow stays below `level` for longer than `FLUTTER`, else the first below."""
    longest, below = round(FLUTTER * len(flow)), 0
    for place, value in enumerate(flow):
        if below:
            below = 0 if value > REOPENED * flow.max() else below + 1
        elif value < level:
            below = 1
        if below > longest:
            return place - below + 1
    return int(np.argmax(flow < level))


def _crossing(time: np.ndarray, flow: np.ndarray, index: int, level: float, cycle: int) -> float:
    """Return the time at which the periodic flow crosses `level` between samples `index` and `index + 1`."""
    turns, k = divmod(index, cycle)
    fraction = (level - flow[k]) / (flow[k + 1] - flow[k])
    return time[k] + fraction * (time[k + 1] - time[k]) + turns * (time[-1] - time[0])


def _open_fraction(time: np.ndarray, flow: np.ndarray) -> float:
    """Return the fraction of the cycle in which a valve passes flow."""
    if not flow.max() > 0.0:
        return 0.0
    excess = flow - VALVE_OPEN * flow.max()
    left, right = excess[:-1], excess[1:]
    positive = np.maximum(left, 0.0) + np.maximum(right, 0.0)
    share = np.divide(positive, np.abs(left) + np.abs(right), out=np.zeros_like(left), where=positive > 0.0)
    return float(share @ np.diff(time) / (time[-1] - time[0]))


def _early_over_late(time: np.ndarray, flow: np.ndarray, closed: float, opens: float) -> float:
    """Return peak mitral flow of the first half of filling over that of the second half (E/A)."""
    moments = np.linspace(closed, opens, 4 * len(time))
    inflow = _Cyclic(time, flow).value_at(moments)
    filling = np.flatnonzero(inflow > VALVE_OPEN * max(inflow.max(), 0.0))
    if not inflow.max() > 0.0 or filling[-1] - filling[0] < 2:
        return np.nan
    middle = (filling[0] + filling[-1]) // 2
    return inflow[filling[0] : middle + 1].max() / inflow[middle + 1 : filling[-1] + 1].max()


def turning_points(flow: np.ndarray) -> float:
    """Score a coronary flow waveform (m+1,) from 0 to 5, the physiological two valleys and two peaks.

    One point for each of two valleys and two peaks, and one if the first turning point of the cycle is a valley: flow
    falls as the ventricle begins to contract. Points that stand out by less than `PROMINENCE` of the range do not
    count.
    """
    cycle = flow[:-1]
    level = PROMINENCE * np.ptp(cycle)
    if not level > 0.0:
        return 0.0
    begin = int(np.argmax(cycle))
    turns, low, high, rising = [], cycle[begin], cycle[begin], False
    at_low = at_high = begin
    for index in range(begin, begin + len(cycle) + 1):
        value = cycle[index % len(cycle)]
        if rising:
            if value > high:
                high, at_high = value, index
            elif value < high - level:
                turns.append((at_high % len(cycle), "peak"))
                rising, low, at_low = False, value, index
        elif value < low:
            low, at_low = value, index
        elif value > low + level:
            turns.append((at_low % len(cycle), "valley"))
            rising, high, at_high = True, value, index
    peaks = 1 + sum(kind == "peak" for _, kind in turns)
    valleys = sum(kind == "valley" for _, kind in turns)
    first = min([*turns, (begin, "peak")])[1]
    return float(min(peaks, 2) + min(valleys, 2) + (first == "valley"))


class _Cyclic:
    """A periodic waveform given at the points of one period: values and integrals at any time."""

    def __init__(self, time: np.ndarray, wave: np.ndarray):
        self.time, self.wave = time, wave
        self.period = time[-1] - time[0]
        self.primitive = np.concatenate([[0.0], np.cumsum(0.5 * (wave[1:] + wave[:-1]) * np.diff(time))])

    def value_at(self, moment):
        return np.interp((moment - self.time[0]) % self.period + self.time[0], self.time, self.wave)

    def integral(self, start: float, end: float) -> float:
        return self._until(end) - self._until(start)

    def _until(self, moment: float) -> float:
        """Integrate from the period's start, exactly for the piecewise linear waveform."""
        turns, phase = divmod(moment - self.time[0], self.period)
        phase += self.time[0]
        left = min(int(np.searchsorted(self.time, phase, side="right")) - 1, len(self.time) - 2)
        width = phase - self.time[left]
        slope = (self.wave[left + 1] - self.wave[left]) / (self.time[left + 1] - self.time[left])
        return turns * self.primitive[-1] + self.primitive[left] + width * (self.wave[left] + 0.5 * slope * width)

    def maximum(self, start: float, end: float) -> float:
        """Return the largest value in [start, end], ends included."""
        grid = np.concatenate([self.time[:-1] + turn * self.period for turn in range(3)])
        inside = grid[(grid > start) & (grid < end)]
        return float(np.max(self.value_at(np.concatenate([[start], inside, [end]]))))
