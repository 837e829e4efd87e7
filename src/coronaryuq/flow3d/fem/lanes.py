"""Width of the vectors of the 3D numba kernels, and how they read what samples share or have of their own.

Every array of a state has the sample index innermost, LANES long. What follows from the mesh has a last axis of 1 if
all samples share one geometry, and of LANES if each has its own; kernels take it as `rows` and read it with `entry`, so
that one source serves both, and shared geometry costs no more than a number.
"""

import numpy as np
from numba import types
from numba.extending import overload

from coronaryuq.core.simd import LanesType, vectors

LANES = 8
"""Samples per lane block; a block with fewer samples is padded with copies of its last."""

load, splat = vectors(LanesType(LANES))


def rows(geometry: np.ndarray) -> np.ndarray:
    """Return an array (..., 1) as (k,) or (..., LANES) as (k, LANES), for kernels."""
    own = geometry.shape[-1] == LANES
    return np.ascontiguousarray(geometry.reshape((-1, LANES) if own else -1))


def entry(array, row):
    """Return entry `row` of `rows`: a number if samples share it, a vector otherwise."""
    raise NotImplementedError("for numba kernels only")


@overload(entry, inline="always")
def _choose_entry(array, row):
    if array.ndim == 1:
        return lambda array, row: array[row]
    return lambda array, row: load(array, row)


def entry_of(array, row, lane):
    """Return entry `row` of `rows` for one lane, a number."""
    raise NotImplementedError("for numba kernels only")


@overload(entry_of, inline="always")
def _choose_entry_of(array, row, lane):
    if array.ndim == 1:
        return lambda array, row, lane: array[row]
    return lambda array, row, lane: array[row, lane]


def lanes(value):
    """Return a number as a vector, and a vector as it is."""
    raise NotImplementedError("for numba kernels only")


@overload(lanes, inline="always")
def _choose_lanes(value):
    if isinstance(value, types.Float):
        return lambda value: splat(value)
    return lambda value: value
