"""Emulator of outlet flows: the residual after 1 / resistance is smooth, and a quadratic fits it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.core.jit import njit
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned

WIDTH = 1.5
"""Width of the design over the expected width of the posterior."""


@dataclass(frozen=True)
class Emulator:
    """log(f_i m_i), the logarithm of bed i's driving pressure up to a constant, as a quadratic in the coordinates y.

    coefficients (features, N): of 1, z_a and z_a z_b (a <= b), z = (y - centre) / scale. `error`: root mean square
    error of log f held out, per outlet, by ten-fold cross-validation.
    """

    centre: np.ndarray
    scale: np.ndarray
    coefficients: np.ndarray
    error: np.ndarray

    @classmethod
    def fit(cls, y: np.ndarray, multipliers: np.ndarray, flows: np.ndarray) -> "Emulator":
        """Least squares on runs of the model: y (n, d), multipliers and flows (n, N)."""
        centre, scale = y.mean(axis=0), y.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        features = _features((y - centre) / scale)
        response = np.log(flows * multipliers)
        fold = np.arange(len(y)) % 10
        residual = np.empty_like(response)
        with threadpool_limits(1):
            for held in range(10):
                out = fold == held
                part = np.linalg.lstsq(features[~out], response[~out], rcond=None)[0]
                residual[out] = response[out] - features[out] @ part
            coefficients = np.linalg.lstsq(features, response, rcond=None)[0]
        return cls(centre, scale, coefficients, np.sqrt(np.mean(residual**2, axis=0)))

    def flows(self, y: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
        """Emulated flows (n, N)."""
        return np.exp(_features((y - self.centre) / self.scale) @ self.coefficients) / multipliers

    def screen(self, space: Conditioned, likelihood: Likelihood) -> Callable[[np.ndarray], np.ndarray]:
        """Return the emulated log posterior (n,) as a function of x (n, d), up to the constant of `Posterior`."""
        low, high = space.prior
        stepped = space.stepped
        fixed = (space.basis, self.centre, self.scale, np.ascontiguousarray(self.coefficients.T),
                 likelihood.mean, likelihood.whitening, likelihood.log_constant, low, high)  # fmt: skip
        return lambda y: _log_posterior(np.ascontiguousarray(y), np.ascontiguousarray(stepped(y)), *fixed)


def design_size(dimension: int) -> int:
    """Twice the number of coefficients."""
    return (dimension + 1) * (dimension + 2)


def design(
    space: Conditioned, likelihood: Likelihood, multipliers: np.ndarray, flows: np.ndarray, count: int,
    random: np.random.Generator, width: float = WIDTH, slope: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Return design points (count, d) in the box: Gaussian, `width` times as wide as the linearised posterior.

    Linearised: f_i proportional to g_i, its fraction of conductance, about the fit's `multipliers` and `flows` (N,),
    and to exp(slope_i . z), slope (N, k), in the coordinates of uncertain parameters.
    """
    centre, beds = space.coordinates(multipliers[None])[0], space.basis.shape[1]
    with threadpool_limits(1):
        by = likelihood.whitening @ ((flows * multipliers)[:, None] * space.basis)
        if slope is not None:
            by = np.hstack([by, likelihood.whitening @ (flows[:, None] * slope)])
        precision = by.T @ by
        precision[range(beds, space.dimension), range(beds, space.dimension)] += 1.0
        root = np.linalg.inv(np.linalg.cholesky(precision)).T
    points: list[np.ndarray] = []
    while len(points) < count:
        y = centre + width * np.sum(root * random.standard_normal(space.dimension), axis=1)
        for _ in range(60):
            if np.isfinite(space.log_prior(y[None])[0]):
                points.append(y)
                break
            y = 0.9 * y
    return np.array(points)


def _features(z: np.ndarray) -> np.ndarray:
    d = z.shape[1]
    a, b = np.triu_indices(d)
    return np.concatenate([np.ones((len(z), 1)), z, z[:, a] * z[:, b]], axis=1)


@njit(cache=True)
def _log_posterior(y, smooth, basis, centre, scale, coefficients, mean, whitening, constant, low, high):
    n, d = y.shape
    outlets, beds = basis.shape
    result = np.empty(n)
    z = np.empty(d)
    residual = np.empty(outlets)
    for row in range(n):
        prior = 0.0
        for a in range(d):
            z[a] = (smooth[row, a] - centre[a]) / scale[a]
        for i in range(outlets):
            relative = 1.0
            for a in range(beds):
                relative += basis[i, a] * y[row, a]
            if not (relative * high >= 1.0 and relative * low <= 1.0):
                prior = -np.inf
                break
            prior -= 2.0 * np.log(relative)
            value = coefficients[i, 0]
            place = 1 + d
            for a in range(d):
                inner = coefficients[i, 1 + a]
                for b in range(a, d):
                    inner += coefficients[i, place] * z[b]
                    place += 1
                value += inner * z[a]
            residual[i] = np.exp(value) * relative - mean[i]
        if prior == -np.inf:
            result[row] = -np.inf
            continue
        for a in range(beds, d):
            prior -= 0.5 * y[row, a] ** 2
        total = 0.0
        for i in range(outlets):
            inner = 0.0
            for j in range(i + 1):
                inner += whitening[i, j] * residual[j]
            total += inner * inner
        result[row] = prior + constant - 0.5 * total
    return result
