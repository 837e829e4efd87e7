"""Compiled parts of a Gaussian process on its own training points.

Every matrix is symmetric there, and none is allocated twice: at a few hundred points fresh memory costs more than
arithmetic, at a few dozen the calls between array operations do.

`parameters`: as in `gaussian_process.negative_log_posterior`.
"""

import numpy as np

from coronaryuq.core.jit import njit


@njit(cache=True)
def covariance(parameters: np.ndarray, a: np.ndarray, jitter: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance (n, n) of outputs at standardised inputs (n, d), its Matérn 5/2 part, and its slope by r².

    jitter: what is added to the noise, of a variance of one and of the signal's.
    """
    n, d = a.shape
    p = len(parameters[d + 3 :]) // d
    signal, linear, noise = np.exp(2 * parameters[d]), np.exp(2 * parameters[d + 1]), np.exp(2 * parameters[d + 2])
    noise += jitter * (1 + signal)
    scaled = a * np.exp(-parameters[:d])
    along = a @ np.ascontiguousarray(parameters[d + 3 :]).reshape(d, p)
    dots, value, slope = scaled @ scaled.T, np.empty((n, n)), np.empty((n, n))
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
        dots[i, i] = signal + linear * norm[i] + noise
    return dots, value, slope


@njit(cache=True)
def gradient(
    parameters: np.ndarray, a: np.ndarray, inverse: np.ndarray, weights: np.ndarray,
    value: np.ndarray, slope: np.ndarray, jitter: float,
) -> np.ndarray:  # fmt: skip
    """Gradient of the negative log likelihood by the parameters.

    inverse (n, n), of which the upper triangle counts, and slope are overwritten; jitter as in `covariance`.
    """
    n, d = a.shape
    p = len(parameters[d + 3 :]) // d
    signal, linear, noise = np.exp(2 * parameters[d]), np.exp(2 * parameters[d + 1]), np.exp(2 * parameters[d + 2])
    by_signal, trace, sums = 0.0, 0.0, np.zeros(n)
    # `inverse` becomes w wᵀ − inverse and `slope` their product.
    for i in range(n):
        for j in range(i, n):
            outer = weights[i] * weights[j] - inverse[i, j]
            by_signal += (1.0 if i == j else 2.0) * outer * value[i, j]
            inverse[i, j] = inverse[j, i] = outer
            pull = outer * slope[i, j]
            slope[i, j] = slope[j, i] = pull
            sums[i] += pull
            if i != j:
                sums[j] += pull
        trace += inverse[i, i]
    lengths = np.exp(-parameters[:d])
    scaled = a * lengths
    met = inverse @ scaled
    # Σ_ij pull_ij (x_i − x_j)(x_i − x_j)ᵀ without an (n, n, d) array; r² = |(x − x') M|² has dr²/dM from it.
    pulled = slope @ a
    found = np.zeros(len(parameters))
    if p == 0:
        for j in range(d):
            moment = 0.0
            for i in range(n):
                moment += a[i, j] * (sums[i] * a[i, j] - pulled[i, j])
            found[j] = 2 * moment * lengths[j] ** 2
    else:
        moments = 2 * (a.T @ (np.expand_dims(sums, 1) * a - pulled))
        for j in range(d):
            found[j] = moments[j, j] * lengths[j] ** 2
        along = np.ascontiguousarray(parameters[d + 3 :]).reshape(d, p)
        found[d + 3 :] = -(moments @ along).ravel()
    by_linear = 0.0
    for j in range(d):
        one = 0.0
        for i in range(n):
            one += scaled[i, j] * met[i, j]
        found[j] += linear * one
        by_linear += linear * one
    found[d] = -by_signal - jitter * signal * trace
    found[d + 1] = -by_linear
    found[d + 2] = -noise * trace
    return found
