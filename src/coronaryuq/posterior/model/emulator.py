"""Emulator of outlet flows: what is left of them after a reference is smooth, and a polynomial fits it.

The reference of `uncertainty: full` is the steady flow through the trees, and what is left is affine to a per cent.
Otherwise it is 1 / resistance, and what is left a quadratic.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln
from threadpoolctl import threadpool_limits

from coronaryuq.core.jit import njit
from coronaryuq.posterior.model.flow_model import Inverse, Posterior
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.linearised import Linearised, Space
from coronaryuq.posterior.model.tissue import PerGram
from coronaryuq.posterior.model.total_resistance import Rescaled

SHARE = 0.1
"""Mass of the defensive component over that of the emulated posterior."""

FREEDOM = 5.0
"""Degrees of freedom of the defensive component."""


@dataclass(frozen=True)
class Emulator:
    """log(f_i s_i), 1 / s_i the reference of bed i's flow, as an affine or quadratic function of the coordinates y.

    coefficients (features, N): of 1, z_a and, of a quadratic, z_a z_b (a <= b), z = (y - centre) / scale. `error`: root
    mean square error of log f held out, per outlet, by ten-fold cross-validation. about (d,), factor (d, d), height: of
    the defensive component, see `defended`: its centre, the Cholesky factor of its precision, and the logarithm of its
    density at the centre; minus infinity without one.
    """

    centre: np.ndarray
    scale: np.ndarray
    coefficients: np.ndarray
    error: np.ndarray
    about: np.ndarray
    factor: np.ndarray
    height: float = -np.inf

    @classmethod
    def fit(cls, y: np.ndarray, inverse: np.ndarray, flows: np.ndarray, quadratic: bool = True) -> "Emulator":
        """Least squares on runs of the model: y (n, d), inverse of the reference and flows (n, N)."""
        centre, scale = y.mean(axis=0), y.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        features = _features((y - centre) / scale, quadratic)
        response = np.log(flows * inverse)
        fold = np.arange(len(y)) % 10
        residual = np.empty_like(response)
        with threadpool_limits(1):
            for held in range(10):
                out = fold == held
                part = np.linalg.lstsq(features[~out], response[~out], rcond=None)[0]
                residual[out] = response[out] - features[out] @ part
            coefficients = np.linalg.lstsq(features, response, rcond=None)[0]
        error, d = np.sqrt(np.mean(residual**2, axis=0)), y.shape[1]
        return cls(centre, scale, coefficients, error, np.zeros(d), np.eye(d))

    @classmethod
    def of_runs(cls, posterior: Posterior, linearised: Linearised, y: np.ndarray, flows: np.ndarray) -> "Emulator":
        """Fit to runs of the model, flows (n, N) at coordinates y (n, d), and defend."""
        space, steady = posterior.space, posterior.inverse_steady
        assert not isinstance(space, Rescaled)  # its states have no emulator
        inverse = space.multipliers(y) if steady is None else steady(y)
        fitted = cls.fit(space.stepped(y), inverse, flows, quadratic=steady is None)
        return fitted.defended(linearised, space, posterior.likelihood, steady)

    def defended(
        self, linearised: Linearised, space: Space, likelihood: Likelihood, steady: Inverse | None = None
    ) -> "Emulator":
        """Return the emulator whose posterior q is a mixture with a Student t about the linearised posterior.

        A chain whose proposals follow q stays about p / q draws where the model's posterior p exceeds q, and its
        averages have a finite variance only if p / q has a finite mean under p (Deligiannidis and Lee, Ann. Appl.
        Probab. 28, 2018). A quadratic errs most far from its centre, and where it errs by several times the noise, q
        would vanish and p not. With the mixture p / q is bounded: p falls as the normal prior of the parameters does,
        or faster, and a Student t slower (a defensive mixture: Hesterberg, Technometrics 37, 1995).

        The mass of the emulated posterior, of which the t has `SHARE`, is taken to be that of a Gaussian as high at the
        centre as it and as wide as the linearised one.
        """
        d = len(linearised.centre)
        top = float(self.screen(space, likelihood, steady)(linearised.centre[None])[0])
        # The density of a t at its centre over that of the Gaussian.
        lower = gammaln(0.5 * (FREEDOM + d)) - gammaln(0.5 * FREEDOM) + 0.5 * d * np.log(2.0 / FREEDOM)
        height = top + float(lower) + np.log(SHARE)
        return replace(self, about=linearised.centre, factor=linearised.factor, height=float(height))

    def flows(self, y: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Emulated flows (n, N), for the inverse of the reference (n, N)."""
        features = _features((y - self.centre) / self.scale, quadratic=len(self.coefficients) > 1 + y.shape[1])
        return np.exp(features @ self.coefficients) / inverse

    def screen(
        self, space: Space, likelihood: Likelihood, steady: Inverse | None = None
    ) -> Callable[[np.ndarray], np.ndarray]:
        """Return the emulated log posterior (n,) as a function of x (n, d), up to the constant of `Posterior`.

        steady: `Posterior.inverse_steady`.
        """
        stepped = space.stepped
        fixed = (self.centre, self.scale, np.ascontiguousarray(self.coefficients.T), likelihood.mean,
                 likelihood.whitening, likelihood.log_constant, self.about, self.factor, self.height)  # fmt: skip
        if isinstance(space, PerGram):
            inverse = space.multipliers if steady is None else steady
            return lambda x: _per_gram(np.ascontiguousarray(x), np.ascontiguousarray(stepped(x)), inverse(x), *fixed)
        assert steady is None
        bounded = (space.basis, *space.prior)
        return lambda y: _conditioned(np.ascontiguousarray(y), np.ascontiguousarray(stepped(y)), *bounded, *fixed)


def _features(z: np.ndarray, quadratic: bool) -> np.ndarray:
    columns = [np.ones((len(z), 1)), z]
    if quadratic:
        a, b = np.triu_indices(z.shape[1])
        columns.append(z[:, a] * z[:, b])
    return np.concatenate(columns, axis=1)


@njit(cache=True)
def _conditioned(y, smooth, basis, low, high, centre, scale, coefficients, mean, whitening, constant,
                 about, factor, height):  # fmt: skip
    """Return the log posterior (n,) in the coordinates of `Conditioned`."""
    n, d = y.shape
    outlets, beds = basis.shape
    result = np.empty(n)
    relative, residual, z = np.empty(outlets), np.empty(outlets), np.empty(d)
    for row in range(n):
        prior = 0.0
        for i in range(outlets):
            relative[i] = 1.0
            for a in range(beds):
                relative[i] += basis[i, a] * y[row, a]
            if not (relative[i] * high >= 1.0 and relative[i] * low <= 1.0):
                prior = -np.inf
                break
            prior -= 2.0 * np.log(relative[i])
        if prior == -np.inf:
            result[row] = -np.inf
            continue
        for a in range(beds, d):
            prior -= 0.5 * y[row, a] ** 2
        _emulate(smooth[row], relative, centre, scale, coefficients, z, residual)
        for i in range(outlets):
            residual[i] -= mean[i]
        value = prior + constant - 0.5 * _misfit(residual, whitening)
        result[row] = _defended(value, y[row], about, factor, height)
    return result


@njit(cache=True)
def _per_gram(x, smooth, inverse, centre, scale, coefficients, mean, whitening, constant,
              about, factor, height):  # fmt: skip
    """Return the log posterior (n,) in the coordinates of `PerGram`, with a `RelativeLikelihood`."""
    n, d = x.shape
    outlets = inverse.shape[1]
    result = np.empty(n)
    relative, residual, z = np.empty(outlets), np.empty(outlets), np.empty(d)
    for row in range(n):
        prior = 0.0
        for a in range(d):
            prior -= 0.5 * x[row, a] ** 2
        for i in range(outlets):
            relative[i] = 1.0 / inverse[row, i]
        _emulate(smooth[row], relative, centre, scale, coefficients, z, residual)
        for i in range(outlets):
            if not residual[i] > 0.0:
                # No steady flow, or one too small for a number.
                prior = -np.inf
                break
            prior -= np.log(residual[i])
            residual[i] = 1.0 - mean[i] / residual[i]
        value = prior + constant - 0.5 * _misfit(residual, whitening) if prior > -np.inf else prior
        result[row] = _defended(value, x[row], about, factor, height)
    return result


@njit(cache=True)
def _emulate(smooth, relative, centre, scale, coefficients, z, flows):
    """Write the emulated flows; relative: to what, up to a constant."""
    d = len(z)
    quadratic = coefficients.shape[1] > 1 + d
    for a in range(d):
        z[a] = (smooth[a] - centre[a]) / scale[a]
    for i in range(len(relative)):
        value = coefficients[i, 0]
        place = 1 + d
        for a in range(d):
            inner = coefficients[i, 1 + a]
            if quadratic:
                for b in range(a, d):
                    inner += coefficients[i, place] * z[b]
                    place += 1
            value += inner * z[a]
        flows[i] = np.exp(value) * relative[i]


@njit(cache=True)
def _misfit(residual, whitening):
    total = 0.0
    for i in range(len(residual)):
        inner = 0.0
        for j in range(i + 1):
            inner += whitening[i, j] * residual[j]
        total += inner * inner
    return total


@njit(cache=True)
def _defended(value, y, about, factor, height):
    """Return the logarithm of the mixture with the defensive component."""
    if height == -np.inf:
        return value
    d = len(y)
    distance = 0.0
    for a in range(d):
        inner = 0.0
        for b in range(a, d):
            inner += factor[b, a] * (y[b] - about[b])
        distance += inner * inner
    defence = height - 0.5 * (FREEDOM + d) * np.log1p(distance / FREEDOM)
    return max(value, defence) + np.log1p(np.exp(-abs(value - defence)))
