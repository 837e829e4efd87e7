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


def far_off(time: np.ndarray, values: np.ndarray, limit: float) -> list[tuple[int, float]]:
    """Return the samples of a waveform that are far off the line between their neighbours, worst first, and how far.

    The worst sample is moved to the line, and so on. Where most samples are off the line, as if an oscillation is
    missed, none of them stands out: it is `typical` that counts then.

    Parameters
    ----------
    time, values
        (k,).
    limit
        As `off` of `off_line`, over what is typical if that is larger than 1.
    """
    left, usual, found = np.array(values), max(1.0, typical(off_line(time, values)[1])), list[tuple[int, float]]()
    while len(values) > 2:
        line, off = off_line(time, left)
        worst = int(np.argmax(np.abs(off)))
        if not abs(off[worst]) > limit * usual:
            break
        found.append((worst + 1, float(off[worst] / usual)))
        left[worst + 1] = line[worst]
    return found


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
