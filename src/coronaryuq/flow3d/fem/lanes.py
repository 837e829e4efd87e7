"""Width of the vectors of the 3D numba kernels. Every array has the sample index innermost, LANES long."""

from coronaryuq.core.simd import LanesType, vectors

LANES = 8
"""Samples per lane block; a block with fewer samples is padded with copies of its last."""

load, splat = vectors(LanesType(LANES))
