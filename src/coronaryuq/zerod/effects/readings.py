"""Readings of a waveform that follow each other closer than its content asks for.

Interpolated readings say nothing of their own, and are left out. Of true ones, four hundred of a beat say no more than
a hundred with half the noise, and cost sixteen times as much: they are averaged in blocks. Predictions are averaged
over the same times, so that an average is no filter.
"""

from dataclasses import dataclass

import numpy as np

PER_SECOND = 150.0
"""Readings per second to which denser ones are averaged: nearly four per period at 40 Hz."""


ON_LINE, OFF_LINE = 0.02, 0.05
"""Distance from the line between the neighbours, in standard deviations, up to which a reading may be interpolated, and
median distance from which on others are not: one reading in 80 of white noise is on the line, and the median is 0.8
off it, or 0.8 / m beside m - 1 interpolated ones."""
MOST_BETWEEN = 7
"""Largest number of interpolated readings between two true ones."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Times (n,) of the readings of one waveform, s, and the first of each block (k,)."""

    times: np.ndarray
    first: np.ndarray

    def averaged(self, values: np.ndarray) -> np.ndarray:
        """Return the averages (..., k) over blocks of values (..., n)."""
        return np.add.reduceat(values, self.first, axis=-1) / np.diff(self.first, append=len(self.times))

    def sd(self, sd: np.ndarray) -> np.ndarray:
        """Return the standard deviations (k,) of averages of independent readings, from theirs (n,)."""
        return np.sqrt(self.averaged(sd**2) / np.diff(self.first, append=len(self.times)))


def dense(times: np.ndarray, period: float) -> Readings | None:
    """Return the blocks of readings at times (n,) of a beat of a length, s; None if they are not denser than needed."""
    size = round(len(times) / period / PER_SECOND)
    return Readings(times, np.arange(0, len(times), size)) if size > 1 else None


def true_readings(times: np.ndarray, values: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Return the numbers of the readings that no linear interpolation between every second, third, ... one made.

    times, values, sd: (n,), increasing.
    """
    numbers = np.arange(len(times))
    share = (times[1:-1] - times[:-2]) / (times[2:] - times[:-2])
    off = np.abs(values[1:-1] - (1.0 - share) * values[:-2] - share * values[2:]) / sd[1:-1]
    for every in range(MOST_BETWEEN + 1, 1, -1):
        for first in range(every):
            true = numbers % every == first
            inner = true[1:-1]
            if inner.any() and (off[~inner] <= ON_LINE).all() and np.median(off[inner]) > OFF_LINE:
                return numbers[true | (numbers < first)]
    return numbers
