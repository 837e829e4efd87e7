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
"""

from collections.abc import Callable

import numpy as np


class Conditioned:
    """Coordinates y (n, N - 1) on the constraint, with the prior conditioned on it.

    Parameters
    ----------
    weights
        Shares of conductance w (N,).
    prior
        Bounds of every multiplier.
    """

    box = None
    adjust: Callable | None = None

    def __init__(self, weights: np.ndarray, prior: tuple[float, float]):
        self.weights = np.asarray(weights, dtype=float) / np.sum(weights)
        self.prior = prior
        self.dimension = len(self.weights) - 1
        self.basis = _complement(self.weights)

    def multipliers(self, y: np.ndarray) -> np.ndarray:
        """Return multipliers (n, N) of r-hat; nan where a fraction of conductance would not be positive."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = 1.0 + _rows_times(y, self.basis.T)
            return np.where(relative > 0, 1.0 / relative, np.nan)

    def coordinates(self, multipliers: np.ndarray) -> np.ndarray:
        """Return the coordinates (n, N - 1) of multipliers that satisfy the constraint."""
        return _rows_times(1.0 / multipliers - 1.0, self.basis)

    def log_prior(self, y: np.ndarray) -> np.ndarray:
        """Return the log density (n,) up to a constant; -inf outside the box."""
        m = self.multipliers(y)
        with np.errstate(invalid="ignore"):
            inside = np.all((m >= self.prior[0]) & (m <= self.prior[1]), axis=1)
        return np.where(inside, 2.0 * np.sum(np.log(np.where(inside[:, None], m, 1.0)), axis=1), -np.inf)

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Return exact independent draws (count, N - 1) of the conditioned prior.

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
        return self.coordinates(np.array(kept))


class Rescaled:
    """The paper's treatment: multipliers (n, N), rescaled after acceptance. Inexact; kept for comparison."""

    def __init__(self, weights: np.ndarray, prior: tuple[float, float]):
        self.weights = np.asarray(weights, dtype=float) / np.sum(weights)
        self.prior = prior
        self.dimension = len(self.weights)
        self.box = np.repeat([[prior[0]], [prior[1]]], self.dimension, axis=1)

    def multipliers(self, m: np.ndarray) -> np.ndarray:
        return m

    def coordinates(self, multipliers: np.ndarray) -> np.ndarray:
        return multipliers

    def log_prior(self, m: np.ndarray) -> np.ndarray:
        """Return zero everywhere: the sampler handles the box, and rescaling may lead slightly out of it."""
        return np.zeros(len(m))

    def adjust(self, m: np.ndarray) -> np.ndarray:
        """Return the multipliers scaled by one factor that restores the total resistance."""
        return m * np.sum(self.weights / m, axis=1, keepdims=True)

    def draw(self, random: np.random.Generator, count: int) -> np.ndarray:
        return self.adjust(random.uniform(*self.prior, size=(count, self.dimension)))


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
