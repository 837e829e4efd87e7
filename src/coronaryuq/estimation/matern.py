"""Compiled parts of a Gaussian process on its own training points.

Every matrix is symmetric there, and none is allocated twice: at a few hundred points fresh memory costs more than
arithmetic.
"""

import numba
import numpy as np


@numba.njit(cache=True)
def covariance(
    dots: np.ndarray, along: np.ndarray, signal: float, linear: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance (n, n), its Matérn 5/2 part, and that part's derivative by r².

    dots (n, n): inner products of scaled inputs, overwritten by the covariance. along (n, p): places along the
    directions.
    """
    n, p = along.shape
    value, slope = np.empty((n, n)), np.empty((n, n))
    norm = np.empty(n)
    for i in range(n):
        norm[i] = dots[i, i]
    for i in range(n):
        for j in range(i):
            square = norm[i] + norm[j] - 2 * dots[i, j]
            for q in range(p):
                square += (along[i, q] - along[j, q]) ** 2
            square = 5 * max(square, 0.0)
            root = np.sqrt(square)
            fall = signal * np.exp(-root)
            value[i, j] = value[j, i] = fall * (1 + root + square / 3)
            slope[i, j] = slope[j, i] = -5 / 6 * fall * (1 + root)
            dots[i, j] = dots[j, i] = value[i, j] + linear * dots[i, j]
        value[i, i], slope[i, i] = signal, -5 / 6 * signal
        dots[i, i] = signal + linear * norm[i]
    return dots, value, slope


@numba.njit(cache=True)
def derivative(inverse: np.ndarray, weights: np.ndarray, value: np.ndarray, slope: np.ndarray) -> float:
    """Turns `inverse` (n, n), of which the lower triangle counts, into w wᵀ − inverse and `slope` into their product.

    Returns the sum of that difference times `value`.
    """
    n, total = len(inverse), 0.0
    for i in range(n):
        for j in range(i + 1):
            outer = weights[i] * weights[j] - inverse[i, j]
            total += (1.0 if i == j else 2.0) * outer * value[i, j]
            inverse[i, j] = inverse[j, i] = outer
            pull = outer * slope[i, j]
            slope[i, j] = slope[j, i] = pull
    return total
