"""Scatter of a waveform's samples about the lines between their neighbours, which smooth errors hardly change."""

from collections.abc import Hashable, Mapping
from typing import TypeVar

import numpy as np

Group = TypeVar("Group", bound=Hashable)
MEDIAN = 0.6744897501960817
"""Median of the absolute value of a standard normal number."""
SURELY, OF_MEDIAN = 5.0, 1.4
"""Standard errors of the log of the ratio of two scatters from which they differ, and the standard error of the log of
the scatter of n samples of a waveform of white noise, times the root of n (by simulation)."""

CLEARLY = 2.0
"""Standard errors by which what is typical of a waveform has to exceed 1 to count."""
LEAST_KEPT = 4
"""Number of samples of which none can be left out."""
COVERED = 2.0
"""Distance of the last sample from the first of the next period, over the median one, up to which they cover it."""
OWN_SIDE = 3.0
"""Standard deviations by which the first or last sample has to be off the line through the two next to it."""


def off_line(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compare the samples of a waveform with the lines between their neighbours.

    By Gasser, Sroka & Jennen-Steinmetz, Biometrika 73 (1986) 625.

    Parameters
    ----------
    time, values
        (k,).

    Returns
    -------
    line, off
        Values on the lines, and by how much the samples are off, over what is expected of white noise of unit standard
        deviation: (k - 2,) each; the first and last sample have only one neighbour.
    """
    after = (time[1:-1] - time[:-2]) / np.maximum(time[2:] - time[:-2], 1e-12)
    line = (1.0 - after) * values[:-2] + after * values[2:]
    return line, (values[1:-1] - line) / np.sqrt(1.0 + after**2 + (1.0 - after) ** 2)


def typical(off: np.ndarray) -> float:
    """Return the standard deviation of which half of the samples are off by less than the median; 0 without any."""
    return float(np.median(np.abs(off))) / MEDIAN if off.size else 0.0


def far_off(time: np.ndarray, values: np.ndarray, limit: float, period: float) -> list[tuple[int, float]]:
    """Return the samples of a waveform that are far off the line between their neighbours, worst first, and how far.

    The worst sample is left out, and so on; at the end, those are taken back that are not far off the line between
    their neighbours that are left, as one between two others that were. Where most samples are off the line, as if an
    oscillation is missed, none of them stands out: it is `typical` that counts then.

    The first and the last sample are neighbours if the samples cover the period; otherwise neither is tested. They also
    have to be off the line through the two next to them, because a drift is a step from the last to the first.

    Parameters
    ----------
    time, values
        (k,).
    limit
        As `off` of `off_line`, over what is typical if that is surely larger than 1.
    period
        Of the waveform, in the unit of time.
    """
    if len(values) <= LEAST_KEPT:
        return []
    left, found = np.arange(len(values)), list[tuple[int, float]]()
    usual = max(1.0, typical(off_line(time, values)[1]) * np.exp(-CLEARLY * OF_MEDIAN / np.sqrt(len(values))))
    covered = time[0] + period - time[-1] <= COVERED * np.median(np.diff(time))

    def off_loop(samples: np.ndarray) -> np.ndarray:
        return _off_loop(time[samples], values[samples], period, covered) / usual

    while len(left) > LEAST_KEPT:
        off = off_loop(left)
        worst = int(np.argmax(np.abs(off)))
        if not abs(off[worst]) > limit:
            break
        found.append((int(left[worst]), float(off[worst])))
        left = np.delete(left, worst)

    def still(sample: int) -> bool:
        own = np.sort(np.append(left, sample))
        return abs(float(off_loop(own)[np.searchsorted(own, sample)])) > limit

    return [(sample, off) for sample, off in found if still(sample)]


def _off_loop(time: np.ndarray, values: np.ndarray, period: float, covered: bool) -> np.ndarray:
    """Return `off_line` for all samples, (k,); zero for ends that are not tested, or are on the line of their side.

    covered: whether the samples cover the period.
    """
    around = np.r_[time[-1] - period, time, time[0] + period], np.r_[values[-1], values, values[0]]
    off = off_line(*around)[1]
    for end, (near, far) in ((0, (1, 2)), (-1, (-2, -3))):
        slope = (values[near] - values[far]) / (time[near] - time[far])
        ahead = (time[end] - time[near]) / (time[near] - time[far])
        beyond = values[end] - values[near] - slope * (time[end] - time[near])
        own = beyond / np.sqrt(1.0 + (1.0 + ahead) ** 2 + ahead**2)
        if not covered or abs(own) < OWN_SIDE or own * off[end] < 0.0:
            off[end] = 0.0
    return off


def larger_scatter(off: Mapping[Group, np.ndarray]) -> dict[Group, float]:
    """Return the groups of samples whose scatter is surely larger than that of the quietest, and how many times.

    As many times as it is that of all groups of which this is not sure.

    off: by how much the samples of each group are off the line, (n,).
    """
    sizes = {name: typical(own) for name, own in off.items() if own.size}
    if not sizes:
        return {}
    quiet = min(sizes, key=lambda name: sizes[name])
    errors = {name: OF_MEDIAN * np.sqrt(1.0 / off[name].size + 1.0 / off[quiet].size) for name in sizes}
    larger = [name for name in sizes if 0.0 < sizes[quiet] < sizes[name] * np.exp(-SURELY * errors[name])]
    usual = typical(np.concatenate([off[name] for name in sizes if name not in larger]))
    return {name: sizes[name] / usual for name in larger}
