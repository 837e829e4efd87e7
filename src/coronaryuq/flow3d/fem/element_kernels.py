"""Operations shared by the element loops of momentum and wall shear, inlined by numba.

A vector is a tuple of three lanes (of velocity, say) or three numbers (a hat function's gradient). The order of
operations is part of the result: it must be the same for all samples and in both loops.
"""

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import fma
from coronaryuq.flow3d.fem.lanes import entry, load


@njit(inline="always", error_model="numpy")
def hats(grad, e):
    """Return the gradients of the four hat functions of element e."""
    k = 12 * e
    a = entry(grad, k), entry(grad, k + 1), entry(grad, k + 2)
    b = entry(grad, k + 3), entry(grad, k + 4), entry(grad, k + 5)
    c = entry(grad, k + 6), entry(grad, k + 7), entry(grad, k + 8)
    d = entry(grad, k + 9), entry(grad, k + 10), entry(grad, k + 11)
    return a, b, c, d


@njit(inline="always", error_model="numpy")
def corners(tets, e):
    """Return the node numbers of element e."""
    return np.int64(tets[e, 0]), np.int64(tets[e, 1]), np.int64(tets[e, 2]), np.int64(tets[e, 3])


@njit(inline="always", error_model="numpy")
def vector(field, i):
    """Return row i of a field (n, 3, LANES)."""
    return load(field, 3 * i), load(field, 3 * i + 1), load(field, 3 * i + 2)


@njit(inline="always", error_model="numpy")
def part(vector, c):
    """Return component c, for a c that is only known at run time."""
    return vector[0] if c == 0 else (vector[1] if c == 1 else vector[2])


@njit(inline="always", error_model="numpy")
def dot(a, b):
    return fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]))


@njit(inline="always", error_model="numpy")
def average(a, b, c, d):
    return 0.25 * ((a + b) + (c + d))


@njit(inline="always", error_model="numpy")
def centre(a, b, c, d):
    """Return the mean of four vectors."""
    return average(a[0], b[0], c[0], d[0]), average(a[1], b[1], c[1], d[1]), average(a[2], b[2], c[2], d[2])


@njit(inline="always", error_model="numpy")
def gradient(ga, gb, gc, gd, a, b, c, d):
    """Return the gradient of the linear function with values a, b, c, d at the corners."""
    x = fma(gd[0], d, fma(gc[0], c, fma(gb[0], b, ga[0] * a)))
    y = fma(gd[1], d, fma(gc[1], c, fma(gb[1], b, ga[1] * a)))
    z = fma(gd[2], d, fma(gc[2], c, fma(gb[2], b, ga[2] * a)))
    return x, y, z
