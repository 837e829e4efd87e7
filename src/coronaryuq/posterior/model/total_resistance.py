"""The constraint: total resistance of the LV-perfusing beds is preserved.

Let m_i be the multiplier of r-hat of bed i and w_i = (1 / r-hat_i) / sum_k (1 / r-hat_k) its share of conductance. The
beds are in parallel, so their total resistance is preserved when sum_i w_i / m_i = 1. (The paper's published draws
satisfy this to 1e-6 for one set of w.) With g_i = w_i / m_i the constraint is a plane, sum g_i = 1.

The prior is uniform in m on a box. Given that sum g_i takes the value 1, its density on that plane, with respect to
the plane's own (Lebesgue) measure, is the density of g: dm_i = w_i / g_i^2 dg_i, hence

    p(g | sum g = 1)  ∝  prod_i g_i^-2   inside the box, 0 outside.

(Conditioning on sum g or on its inverse, the total resistance, is the same: their gradients are parallel.) The sampler
works in N - 1 coordinates y of the plane, h = g / w - 1 = U y, with U an orthonormal basis of w's complement.

Rescaling states after they are accepted, as the paper does, is another chain: its proposals leave the plane and are
projected back, forward and backward moves no longer have equal densities, and the acceptance ratio ignores that.

Uncertain parameters of the network (`zerod.theta`) add k coordinates z, independent of the others and standard normal
in the prior.
"""

from collections.abc import Callable

import numpy as np

from coronaryuq.zerod.theta import Laws

FARTHEST = 12.0
"""Bound of the standard normal coordinates where the sampler needs a box."""


class Conditioned:
    """Coordinates (n, N - 1 + k): y on the constraint, with the prior conditioned on it, then z.

    Parameters
    ----------
    weights
        Shares of conductance w (N,).
    prior
        Bounds of every multiplier.
    laws
        Of the k uncertain parameters of the network.
    """

    box = None
    adjust: Callable | None = None
    further: tuple[str, ...] = ()
    """Inputs of the model between the multipliers and the parameters."""

    def __init__(self, weights: np.ndarray, prior: tuple[float, float], laws: Laws | None = None):
        self.weights = np.asarray(weights, dtype=float) / np.sum(weights)
        self.prior = prior
        self.laws = Laws() if laws is None else laws
        self.dimension = len(self.weights) - 1 + len(self.laws)
        self.basis = _complement(self.weights)

    @property
    def prior_precision(self) -> np.ndarray:
        """Diagonal (d,) of the prior's precision, as good as none on the constraint."""
        return np.repeat([0.0, 1.0], [self.basis.shape[1], len(self.laws)])

    def multipliers(self, x: np.ndarray) -> np.ndarray:
        """Return multipliers (n, N) of r-hat; nan where a fraction of conductance would not be positive."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = 1.0 + _rows_times(x[:, : self.basis.shape[1]], self.basis.T)
            return np.where(relative > 0, 1.0 / relative, np.nan)

    def standard(self, x: np.ndarray) -> np.ndarray:
        """Return the standard normal coordinates z (n, k)."""
        return x[:, self.basis.shape[1] :]

    def stepped(self, x: np.ndarray) -> np.ndarray:
        """Return the coordinates with those of choices replaced by the number that they choose, for an emulator."""
        if not self.laws.choices:
            return x
        return np.hstack([x[:, : self.basis.shape[1]], self.laws.stepped(self.standard(x))])

    def inputs(self, x: np.ndarray) -> np.ndarray:
        """Return multipliers and values of the uncertain parameters (n, N + k)."""
        return _joined(self.multipliers(x), self.standard(x), self.laws)

    def coordinates(self, multipliers: np.ndarray) -> np.ndarray:
        """Return the coordinates (n, N - 1 + k) of multipliers that satisfy the constraint, with z = 0."""
        return _with_zeros(_rows_times(1.0 / multipliers - 1.0, self.basis), len(self.laws))

    def linearised(self, multipliers: np.ndarray, flows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates (d,) and derivatives (N, N - 1) of the flows by those on the constraint.

        Of flows (N,) at multipliers (N,), taken as proportional to each bed's conductance.
        """
        return self.coordinates(multipliers[None])[0], (flows * multipliers)[:, None] * self.basis

    def log_prior(self, x: np.ndarray) -> np.ndarray:
        """Return the log density (n,) up to a constant; -inf outside the box."""
        m = self.multipliers(x)
        with np.errstate(invalid="ignore"):
            inside = np.all((m >= self.prior[0]) & (m <= self.prior[1]), axis=1)
        density = 2.0 * np.sum(np.log(np.where(inside[:, None], m, 1.0)), axis=1)
        return np.where(inside, density - 0.5 * np.sum(self.standard(x) ** 2, axis=1), -np.inf)

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Return exact independent draws (count, N - 1 + k) of the conditioned prior.

        All multipliers but the one with the largest share are uniform, that one follows from the constraint, and the
        draw is kept with probability proportional to its square: the density of the others under the constraint.
        """
        low, high = self.prior
        last = int(np.argmax(self.weights))
        kept: list[np.ndarray] = []
        while len(kept) < count:
            m = random.uniform(low, high, size=len(self.weights))
            accept = random.uniform()
            others = np.sum(np.delete(self.weights / m, last))
            if others >= 1.0:
                continue
            m[last] = self.weights[last] / (1.0 - others)
            if low <= m[last] <= high and accept < (m[last] / high) ** 2:
                kept.append(m)
        x = self.coordinates(np.array(kept))
        if len(self.laws):
            self.standard(x)[:] = random.standard_normal((count, len(self.laws)))
        return x

    def outside(self, multipliers: np.ndarray) -> np.ndarray:
        """Return whether each multiplier (N,) lies outside the prior."""
        return _outside(multipliers, self.prior)

    def ranges(self, share: tuple[float, float]) -> np.ndarray:
        """Return the quantiles (N, 2) of each multiplier in the prior, before it is conditioned."""
        return _ranges(self.prior, share, len(self.weights))


class Rescaled:
    """The paper's treatment: multipliers (n, N), rescaled after acceptance, then z. Inexact; kept for comparison."""

    further: tuple[str, ...] = ()

    def __init__(self, weights: np.ndarray, prior: tuple[float, float], laws: Laws | None = None):
        self.weights = np.asarray(weights, dtype=float) / np.sum(weights)
        self.prior = prior
        self.laws = Laws() if laws is None else laws
        beds, parameters = len(self.weights), len(self.laws)
        self.dimension = beds + parameters
        ends = np.array([[prior[0]] * beds, [prior[1]] * beds])
        far = np.array([[-FARTHEST] * parameters, [FARTHEST] * parameters])
        self.box = np.hstack([ends, far])

    def multipliers(self, x: np.ndarray) -> np.ndarray:
        return x[:, : len(self.weights)]

    def standard(self, x: np.ndarray) -> np.ndarray:
        """Return the standard normal coordinates z (n, k)."""
        return x[:, len(self.weights) :]

    def inputs(self, x: np.ndarray) -> np.ndarray:
        """Return multipliers and values of the uncertain parameters (n, N + k)."""
        return _joined(self.multipliers(x), self.standard(x), self.laws)

    def coordinates(self, multipliers: np.ndarray) -> np.ndarray:
        return _with_zeros(multipliers, len(self.laws))

    def log_prior(self, x: np.ndarray) -> np.ndarray:
        """Return that of z alone: the sampler handles the box, and rescaling may lead slightly out of it."""
        return -0.5 * np.sum(self.standard(x) ** 2, axis=1)

    def adjust(self, x: np.ndarray) -> np.ndarray:
        """Return the coordinates with multipliers scaled by one factor that restores the total resistance."""
        m = self.multipliers(x)
        return np.hstack([m * np.sum(self.weights / m, axis=1, keepdims=True), self.standard(x)])

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        x = _with_zeros(random.uniform(*self.prior, size=(count, len(self.weights))), len(self.laws))
        if len(self.laws):
            self.standard(x)[:] = random.standard_normal((count, len(self.laws)))
        return self.adjust(x)

    def outside(self, multipliers: np.ndarray) -> np.ndarray:
        """Return whether each multiplier (N,) lies outside the prior."""
        return _outside(multipliers, self.prior)

    def ranges(self, share: tuple[float, float]) -> np.ndarray:
        """Return the quantiles (N, 2) of each multiplier in the prior, before it is rescaled."""
        return _ranges(self.prior, share, len(self.weights))


def _outside(multipliers: np.ndarray, prior: tuple[float, float]) -> np.ndarray:
    return (multipliers <= prior[0]) | (multipliers >= prior[1])


def _ranges(prior: tuple[float, float], share: tuple[float, float], count: int) -> np.ndarray:
    return np.tile(np.quantile(prior, share), (count, 1))


def _joined(multipliers: np.ndarray, z: np.ndarray, laws: Laws) -> np.ndarray:
    return np.hstack([multipliers, laws.values(z)]) if len(laws) else multipliers


def _with_zeros(x: np.ndarray, count: int) -> np.ndarray:
    return np.hstack([x, np.zeros((len(x), count))])


def _complement(weights: np.ndarray) -> np.ndarray:
    """Orthonormal basis (N, N - 1) of the vectors orthogonal to `weights`, by one Householder reflection."""
    axis = -weights / np.sqrt(np.sum(weights**2))
    axis[-1] += 1.0
    size = np.sum(axis**2)
    basis = np.eye(len(weights))
    if size > 0:
        basis -= 2.0 * np.outer(axis, axis) / size
    return basis[:, :-1]


def _rows_times(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """rows @ matrix, each row summed in an order that does not depend on how many rows there are."""
    return np.sum(rows[:, :, None] * matrix[None], axis=1)
