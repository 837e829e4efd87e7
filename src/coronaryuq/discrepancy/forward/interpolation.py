"""Interpolation of many waveforms at the times at which they were measured."""

import numpy as np


def interpolated(waves: np.ndarray, grid: np.ndarray, time: np.ndarray, late: np.ndarray, period: float) -> np.ndarray:
    """Return waves (n, k) on a grid (k,) at times (m,) of a periodic beat, each read later by `late` (n,), s: (n, m).

    Waves that are read at the same times are interpolated together, to the bits of `np.interp`.
    """
    found = np.empty((len(waves), len(time)))
    slopes = np.diff(waves, axis=1) / np.diff(grid)
    for shift in np.unique(late):
        rows, at = np.flatnonzero(late == shift), (time - shift) % period
        before = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2)
        found[rows] = slopes[rows[:, None], before] * (at - grid[before]) + waves[rows[:, None], before]
    return found
