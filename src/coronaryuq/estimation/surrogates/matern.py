"""Compiled parts of a Gaussian process on its own training points.

Every matrix is symmetric there, and none is allocated twice: at a few hundred points fresh memory costs more than
arithmetic, at a few dozen the calls between array operations do.

`parameters`: as in `gaussian_process.negative_log_posterior`.
"""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.jit import njit


@dataclass(frozen=True)
class Memory:
    """Arrays for `covariance` of n inputs, filled anew by each call: fresh memory costs more than the arithmetic.

    Each of (n, n), of which the upper triangle counts: covariance of outputs, its Matérn 5/2 part, its slope by r².
    roots, fall (n (n − 1) / 2,): √5 r of the pairs above the diagonal, row after row, and exp(−√5 r).
    """

    outputs: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    roots: np.ndarray
    fall: np.ndarray

    @classmethod
    def of(cls, n: int) -> "Memory":
        pairs = n * (n - 1) // 2
        return cls(np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty(pairs), np.empty(pairs))


def covariance(parameters: np.ndarray, a: np.ndarray, jitter: float, memory: Memory) -> np.ndarray:
    """Fill `memory` for standardised inputs (n, d); return the covariance (n, n) of outputs, its upper triangle.

    jitter: what is added to the noise, of a variance of one and of the signal's. The exponential is NumPy's, which
    takes several numbers at a time.
    """
    _distances(parameters, a, memory.outputs, memory.roots)
    np.negative(memory.roots, out=memory.fall)
    np.exp(memory.fall, out=memory.fall)
    _fill(parameters, a.shape[1], jitter, memory.outputs, memory.value, memory.slope, memory.roots, memory.fall)
    return memory.outputs


@njit(cache=True)
def _distances(parameters: np.ndarray, a: np.ndarray, dots: np.ndarray, roots: np.ndarray) -> None:
    """Set `dots` to products (n, n) of scaled inputs, and `roots`."""
    n, d = a.shape
    p = len(parameters[d + 3 :]) // d
    scaled = a * np.exp(-parameters[:d])
    along = (a @ np.ascontiguousarray(parameters[d + 3 :]).reshape(d, p)).T.copy()
    np.dot(scaled, scaled.T, out=dots)
    norm, start = np.empty(n), 0
    for i in range(n):
        norm[i] = dots[i, i]
    for i in range(n):
        row = roots[start : start + n - 1 - i]
        for k in range(len(row)):
            row[k] = norm[i] + norm[i + 1 + k] - 2 * dots[i, i + 1 + k]
        for q in range(p):
            for k in range(len(row)):
                row[k] += (along[q, i] - along[q, i + 1 + k]) ** 2
        for k in range(len(row)):
            row[k] = np.sqrt(5 * max(row[k], 0.0))
        start += len(row)


@njit(cache=True)
def _fill(
    parameters: np.ndarray, d: int, jitter: float, outputs: np.ndarray, value: np.ndarray, slope: np.ndarray,
    roots: np.ndarray, fall: np.ndarray,
) -> None:  # fmt: skip
    """Set the upper triangles of the three arrays; `outputs` has products of scaled inputs."""
    n, start = len(outputs), 0
    signal, linear, noise = np.exp(2 * parameters[d]), np.exp(2 * parameters[d + 1]), np.exp(2 * parameters[d + 2])
    noise += jitter * (1 + signal)
    for i in range(n):
        value[i, i], slope[i, i] = signal, -5 / 6 * signal
        outputs[i, i] = signal + linear * outputs[i, i] + noise
        for k in range(n - 1 - i):
            root, part = roots[start + k], signal * fall[start + k]
            value[i, i + 1 + k] = part * (1 + root + root**2 / 3)
            slope[i, i + 1 + k] = -5 / 6 * part * (1 + root)
            outputs[i, i + 1 + k] = value[i, i + 1 + k] + linear * outputs[i, i + 1 + k]
        start += n - 1 - i


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
