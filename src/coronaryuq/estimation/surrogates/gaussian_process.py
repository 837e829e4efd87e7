"""Gaussian process regression whose metric has a length scale per input and a few directions across inputs.

Own code because scikit-learn has no such metric and builds an (n, n, d) array for its gradient: at 400 points and 25
inputs this one is about ten times cheaper. A test compares its predictions with scikit-learn's where both have the same
kernel.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.optimize import minimize

from coronaryuq.estimation.surrogates import matern

# Prior of a standardised problem, as (mean, standard deviation). Few inputs matter for one output, and the length
# scales of the others must be able to become very large: without the prior small pilots are overfitted. All but
# DIRECTION are of logarithms.
LENGTH = (2.0, 1.5)
SIGNAL = (0.0, 1.5)
LINEAR = (-1.0, 2.0)
NOISE = (-6.0, 3.0)
DIRECTION = (0.0, 0.3)
JITTER = 1e-10
FEW = 120
BLOCK = 64
# Relative gain of the log posterior at which a search ends. A thousandth of it changes no held-out error by more than
# 0.2 % (rows 1, 5, 8 and a smooth pair, 50 and 250 runs) and takes a third more evaluations.
GAIN = 1e-6


@dataclass(frozen=True)
class GaussianProcess:
    """A fitted process: k = s² m(r²) + l² Σ x x' / L² plus noise, m the Matérn 5/2 correlation.

    r² = Σ_j (x_j − x_j')² / L_j² + Σ_p (w_p · (x − x'))²: the directions w_p let it vary along a sum of inputs, such as
    a total resistance, which no product of single inputs expresses. Inputs and outputs are standardised inside by
    the training set's moments. `inverse` (n, n) of the standardised covariance with noise. `leave_one_out` (n,): y
    minus the prediction without that point, at the final parameters.
    """

    x: np.ndarray
    shift: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    parameters: np.ndarray
    mean: float
    spread: float
    inverse: np.ndarray
    leave_one_out: np.ndarray

    def predict(self, x: np.ndarray) -> np.ndarray:
        """Posterior mean (m,) at inputs (m, d)."""
        scaled = (x - self.shift) / self.scale
        return self.mean + self.spread * _times_weights(self.parameters, scaled, self.x, self.weights)

    def influence(self, x: np.ndarray) -> np.ndarray:
        """Prediction at inputs (m, d) minus the prediction without training point l, (m, n), at the same parameters."""
        scaled = (x - self.shift) / self.scale
        return _times_weights(self.parameters, scaled, self.x, self.inverse) * self.leave_one_out

    def variance(self, x: np.ndarray) -> np.ndarray:
        """Posterior variance (m,) of an output with its noise at inputs (m, d)."""
        d = len(self.shift)
        signal, linear, noise = np.exp(2 * self.parameters[d : d + 3])
        scaled = (x - self.shift) / self.scale
        prior = signal + linear * ((scaled * np.exp(-self.parameters[:d])) ** 2).sum(axis=1)
        to_training = _times_weights(self.parameters, scaled, self.x, np.eye(len(self.x)))
        known = ((to_training @ self.inverse) * to_training).sum(axis=1)
        return self.spread**2 * (np.maximum(prior - known, 0.0) + noise + JITTER * (1 + signal))

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """Posterior covariance (m, m) of outputs without their noise at inputs (m, d)."""
        scaled = (x - self.shift) / self.scale
        to_training = _times_weights(self.parameters, scaled, self.x, np.eye(len(self.x)))
        prior = _times_weights(self.parameters, scaled, scaled, np.eye(len(scaled)))
        return self.spread**2 * (prior - (to_training @ self.inverse) @ to_training.T)


def fit(x: np.ndarray, y: np.ndarray, directions: int = 0, evaluations: int = 60) -> GaussianProcess:
    """Fit to inputs (n, d) and outputs (n,) by the maximum of marginal likelihood times prior.

    The search runs on at most FEW points first and goes on with all of them, which saves most of the cubic cost.
    Leave-one-out residuals follow Sundararajan and Keerthi 2001.
    """
    mean, spread = float(y.mean()), float(y.std()) or 1.0
    shift, scale = x.mean(axis=0), x.std(axis=0)
    scale = np.where(scale > 1e-12 * (np.abs(shift) + 1e-300), scale, 1.0)
    a, b = (x - shift) / scale, (y - mean) / spread
    d = a.shape[1]
    # The directions start small and unlike each other: at zero their gradient vanishes.
    start = 0.1 * np.cos(1.0 + np.arange(d * directions) * 2.399963)
    parameters = np.concatenate([np.full(d, LENGTH[0]), [SIGNAL[0], LINEAR[0], NOISE[0]], start])
    few = np.linspace(0, len(a) - 1, min(len(a), FEW)).round().astype(int)
    parameters = _search(parameters, a[few], b[few], evaluations)
    if len(few) < len(a):
        parameters = _search(parameters, a, b, evaluations // 2)
    k = training_covariance(parameters, a)
    factor = cholesky(k, lower=True)
    inverse = cho_solve((factor, True), np.eye(len(factor)))
    weights = cho_solve((factor, True), b)
    # One step of iterative refinement: a smooth function makes the kernel matrix nearly singular.
    weights = weights + cho_solve((factor, True), b - k @ weights)
    missed = spread * weights / np.diag(inverse)
    return GaussianProcess(a, shift, scale, weights, parameters, mean, spread, inverse, missed)


def training_covariance(parameters: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of outputs with their noise at standardised inputs (n, d)."""
    upper = matern.covariance(parameters, a, JITTER, matern.Memory.of(len(a)))
    return np.triu(upper) + np.triu(upper, 1).T


def negative_log_posterior(
    parameters: np.ndarray, a: np.ndarray, b: np.ndarray, memory: matern.Memory
) -> tuple[float, np.ndarray]:
    """Value and gradient for standardised data a (n, d), b (n,).

    `parameters`: logarithms of d length scales, signal, linear and noise, then the directions (d, p) flat.
    """
    n, d = a.shape
    k = matern.covariance(parameters, a, JITTER, memory)
    # One block of memory holds the covariance, its factor, its inverse and w wᵀ − inverse in turn.
    factor, failed = dpotrf(k.T, lower=1, overwrite_a=1)
    if failed:
        return 1e10, np.zeros_like(parameters)
    weights, _ = dpotrs(factor, b, lower=1)
    value = 0.5 * b @ weights + np.log(factor.diagonal()).sum() + 0.5 * n * np.log(2 * np.pi)
    inverse, _ = dpotri(factor, lower=1, overwrite_c=1)
    gradient = matern.gradient(parameters, a, inverse.T, weights, memory.value, memory.slope, JITTER)
    ahead = len(parameters) - d - 3
    centre, width = (
        np.array([LENGTH[i]] * d + [SIGNAL[i], LINEAR[i], NOISE[i]] + [DIRECTION[i]] * ahead) for i in (0, 1)
    )
    offset = (parameters - centre) / width
    return value + 0.5 * offset @ offset, gradient + offset / width


def _search(parameters, a, b, evaluations):
    d = a.shape[1]
    bounds = [(-4.0, 12.0)] * d + [(-6.0, 2.5), (-12.0, 2.5), (-13.0, 1.0)]
    bounds += [(-5.0, 5.0)] * (len(parameters) - len(bounds))
    options = {"maxfun": evaluations, "maxiter": evaluations, "ftol": GAIN}
    data = (a, b, matern.Memory.of(len(a)))
    found = minimize(
        negative_log_posterior, parameters, args=data, jac=True, method="L-BFGS-B", bounds=bounds, options=options
    )
    return found.x


def _metric(parameters, d):
    return np.column_stack([np.diag(np.exp(-parameters[:d])), parameters[d + 3 :].reshape(d, -1)])


def _times_weights(parameters, a, b, weights):
    """Kernel (n, m) between inputs (n, d) and (m, d), times weights (m,) or (m, p)."""
    d, n = a.shape[1], len(a)
    if n % BLOCK == 1:  # products with a single row are rounded differently: let no block have one
        a = np.concatenate([a, a[-1:]])
    signal, linear = np.exp(2 * parameters[d : d + 2])
    metric = _metric(parameters, d)
    u, v = a @ metric, b @ metric
    out = linear * (u[:, :d] @ (v[:, :d].T @ weights))
    # In place and by blocks that fit into a cache: memory traffic costs more than arithmetic.
    for start in range(0, len(u), BLOCK):
        block = u[start : start + BLOCK]
        square = block @ v.T
        square *= -2
        square += (block**2).sum(1)[:, None]
        square += (v**2).sum(1)
        square *= 5
        np.maximum(square, 0.0, out=square)
        root = np.sqrt(square)
        fall = np.exp(-root)
        square /= 3
        square += root
        square += 1
        square *= fall
        out[start : start + BLOCK] += signal * (square @ weights)
    return out[:n]
