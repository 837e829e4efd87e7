"""Interpolation of many waveforms at the times at which they were measured."""

from functools import lru_cache

import numpy as np


def interpolated(waves: np.ndarray, duration: float, time: np.ndarray, late: np.ndarray, period: float) -> np.ndarray:
    """Return waves (n, k) over `duration`, both ends included, at times (m,) of a periodic beat, as (n, m).

    late: by how much later each wave is read, (n,), s. To the bits of `np.interp`.
    """
    grid = _grid(duration, waves.shape[1])
    # Nearly always, all waves are read at the same times.
    at = (time - (late[:1] if (late == late[0]).all() else late)[:, None]) % period
    before = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2)
    rows = np.arange(len(waves))[:, None]
    start, begin = waves[rows, before], grid[before]
    return (waves[rows, before + 1] - start) / (grid[before + 1] - begin) * (at - begin) + start


@lru_cache
def _grid(duration: float, points: int) -> np.ndarray:
    return np.linspace(0.0, duration, points)
