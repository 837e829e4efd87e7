"""Width of the vectors of the 0D numba kernels, and tables of one sample per lane."""

import numpy as np

from coronaryuq.core.simd import LanesType, vectors

LANES = 16
load, splat = vectors(LanesType(LANES, contract=True))


def table(rows: int, fill: float = 0.0) -> np.ndarray:
    """Return a (rows, LANES) array that starts on a cache line."""
    room = np.empty(rows * LANES + 8)
    skip = (-room.ctypes.data // 8) % 8
    aligned = room[skip : skip + rows * LANES].reshape(rows, LANES)
    aligned[:] = fill
    return aligned
