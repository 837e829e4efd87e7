"""Flexible discrepancy in the likelihood: evidence of a linearised model with an unknown error of any amplitude.

Whitened data e (N,) = G z + tau F w + noise, with z, w and the noise standard normal a priori (Kennedy & O'Hagan 2001).
The amplitude tau distinguishes two hypotheses about the same model:

- the model is right, within its own error: tau is small, half-normal about `MODEL_ERROR`, or zero;
- something else is missing: tau is at least twice that, of any size, uniformly in its logarithm.

F has independent blocks of rows, one per measured place and quantity, F = U S V', so that the covariance of the data
given z is I + tau^2 U S^2 U' and all amplitudes share one decomposition.

Some columns L of G are the same in every model of the data: shapes of errors of the vessels, the time steps and
correlated noise, of which there may be hundreds. Their part of the precision is inverted once, and each model needs
the Schur complement of its other columns alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from coronaryuq.core.mixture import mixture_moments

AMPLITUDES = np.array([0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4])
"""Amplitudes as fractions of the largest value of a series."""
MODEL_ERROR = 0.005
"""Standard deviation of the error of a model with no missing effect, as a fraction of the largest value of a series."""


def _normalised(weights: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.log(weights / weights.sum())


_HALF_NORMAL = AMPLITUDES * np.exp(-0.5 * (AMPLITUDES / MODEL_ERROR) ** 2)
# A density in tau on points that are equidistant in log tau.
RIGHT = _normalised(np.where(AMPLITUDES == 0.0, _HALF_NORMAL.sum(), _HALF_NORMAL))
"""Log prior of the amplitudes if the model is right: half for none."""
UNKNOWN = _normalised((AMPLITUDES >= 2.0 * MODEL_ERROR).astype(float))
"""Log prior of the amplitudes if something else is missing."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior of a linearised model by amplitude (T of them).

    Attributes
    ----------
    log_evidence
        Log marginal likelihood of each amplitude (T,), up to the constant of `gauss_newton`.
    mean
        Of the parameters z: (T, p).
    model
        The sensitivities.
    """

    log_evidence: np.ndarray
    mean: np.ndarray
    model: "Projection" = field(repr=False)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of z by amplitude: (T, p, p)."""
        return self.model.covariance

    def lowered(self, nats: float) -> "Posterior":
        """Return the posterior with all evidence lower by some nats."""
        return replace(self, log_evidence=self.log_evidence - nats)

    @property
    def right(self) -> float:
        """Log evidence of the model as right, within its own error."""
        return float(logsumexp(self.log_evidence + RIGHT))

    @property
    def amplitude(self) -> float:
        """Most probable amplitude of something else."""
        return float(AMPLITUDES[int(np.argmax(self.log_evidence + UNKNOWN))])

    def moments(self, prior: np.ndarray = RIGHT) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (p,) and covariance (p, p) of z, averaged over the amplitudes, by default of a right model."""
        weights = np.exp(self.log_evidence + prior - logsumexp(self.log_evidence + prior))
        return mixture_moments(weights, self.mean, self.covariance)


Known = tuple[Sequence[int], np.ndarray]


class Flexible:
    """Decomposition of the features of some rows, shared by all models of these rows.

    Parameters
    ----------
    features
        Whitened features of unit amplitude: (N, k).
    blocks
        Number of the independent block of each row: (N,). Features of different blocks have no common column.
    known
        Columns of all models' sensitivities that are the same in all, and these (N, q).
    widened
        Log of the factor by which the volume of the noise exceeds that of other hypotheses: it lowers the evidence.
    """

    def __init__(self, features: np.ndarray, blocks: np.ndarray, known: Known | None = None, widened: float = 0.0):
        columns, shapes = known or ((), np.zeros((len(features), 0)))
        self.columns, self.shapes, self.widened = np.array(columns, dtype=int), shapes, widened
        self.blocks: list[tuple[np.ndarray, np.ndarray]] = []
        squares = []
        for number in np.unique(blocks):
            rows = np.flatnonzero(blocks == number)
            own = features[rows]
            values, vectors = np.linalg.eigh(own @ own.T)
            kept = values > 1e-9 * max(float(values[-1]), 1e-300)
            self.blocks.append((rows, vectors[:, kept]))
            squares.append(values[kept])
        spread = np.multiply.outer(AMPLITUDES**2, np.concatenate(squares))
        self.explained = spread / (1.0 + spread)
        """Fraction of the variance along each direction that belongs to the discrepancy, by amplitude: (T, k)."""
        self.log_determinant = np.log1p(spread).sum(axis=1) + 2.0 * widened

    def along(self, vectors: np.ndarray) -> np.ndarray:
        """Return the components of vectors (N, m) along all directions: (k, m)."""
        return np.concatenate([directions.T @ vectors[rows] for rows, directions in self.blocks])

    def posterior(self, at_zero: np.ndarray, jacobian: np.ndarray) -> Posterior:
        """Condition the linear model on its data.

        Parameters
        ----------
        at_zero
            Whitened residual at z = 0: (N,).
        jacobian
            Whitened sensitivities: (N, p).

        Returns
        -------
        Posterior
            Evidence and moments by amplitude.
        """
        model = Projection(self, jacobian)
        return Posterior(*model.condition(model.weighted(at_zero)), model)

    @cached_property
    def shape_parts(self) -> np.ndarray:
        """Components of the shapes along all directions: (k, q)."""
        return self.along(self.shapes)

    @cached_property
    def shape_covariance(self) -> np.ndarray:
        """Covariance of the weights of the shapes, given data and nothing else unknown, by amplitude: (T, q, q)."""
        return np.linalg.inv(self._shape_precision)

    @cached_property
    def shape_determinant(self) -> np.ndarray:
        """Log determinant of their precision: (T,)."""
        return np.linalg.slogdet(self._shape_precision)[1]

    @cached_property
    def _shape_precision(self) -> np.ndarray:
        plain = np.eye(self.shapes.shape[1]) + self.shapes.T @ self.shapes
        return np.array([plain - (self.shape_parts.T * share) @ self.shape_parts for share in self.explained])


@dataclass(frozen=True)
class Weighted:
    """A vector v (N,) weighted by the covariance C of each amplitude.

    vector: v; parts: its components (k,); shapes: L'C^-1 v (T, q); others: of the other columns H, what the shapes do
    not explain, H'C^-1 v - K'L'C^-1 v (T, m); by_shapes, by_others: A^-1 and S^-1 times these.
    """

    vector: np.ndarray
    parts: np.ndarray
    shapes: np.ndarray
    others: np.ndarray
    by_shapes: np.ndarray
    by_others: np.ndarray


class Projection:
    """Sensitivities G (N, p) of a model under every amplitude, for inner products v'(C + GG')^-1 w.

    G has the shapes L of the discrepancy's rows as some of its columns, or none of them. Of the others, H (N, m), and
    with A = I + L'C^-1 L and B = L'C^-1 H: K = A^-1 B, and the Schur complement S = I + H'C^-1 H - B'K.
    """

    def __init__(self, flexible: Flexible, jacobian: np.ndarray):
        known = flexible.columns
        if known.size and not np.array_equal(jacobian[:, known], flexible.shapes):
            raise ValueError("the columns of the shapes are not those of the shapes")
        self.flexible, self.count = flexible, jacobian.shape[1]
        self.columns = np.setdiff1d(np.arange(self.count), known)
        self.others = jacobian[:, self.columns]
        self.parts = flexible.along(self.others)
        inner = np.eye(len(self.columns)) + self.others.T @ self.others
        cross = flexible.shapes.T @ self.others
        shared = [(flexible.shape_parts.T * share) @ self.parts for share in flexible.explained]
        own = np.array([inner - (self.parts.T * share) @ self.parts for share in flexible.explained])
        coupling = cross - np.array(shared)
        self.gains = flexible.shape_covariance @ coupling
        """K by amplitude: (T, q, m)."""
        schur = own - coupling.transpose(0, 2, 1) @ self.gains
        self.spread = np.linalg.inv(schur)
        """S^-1 by amplitude: (T, m, m)."""
        determinant = np.linalg.slogdet(schur)[1] + flexible.shape_determinant
        self.constants = -0.5 * (determinant + flexible.log_determinant)
        """Terms of the log evidence that do not depend on the data: (T,)."""

    @cached_property
    def covariance(self) -> np.ndarray:
        """Posterior covariances of z by amplitude: (T, p, p)."""
        found = np.empty((len(self.spread), self.count, self.count))
        known, own = self.flexible.columns, self.columns
        both = -self.gains @ self.spread
        found[:, own[:, None], own] = self.spread
        found[:, known[:, None], own], found[:, own[:, None], known] = both, both.transpose(0, 2, 1)
        found[:, known[:, None], known] = self.flexible.shape_covariance - both @ self.gains.transpose(0, 2, 1)
        return found

    def weighted(self, vector: np.ndarray) -> Weighted:
        """Return the products of a vector (N,) with the sensitivities."""
        parts = self.flexible.along(vector[:, None])[:, 0]
        shared = self.flexible.explained * parts
        shapes = self.flexible.shapes.T @ vector - shared @ self.flexible.shape_parts
        others = self.others.T @ vector - shared @ self.parts - _each(self.gains.transpose(0, 2, 1), shapes)
        by_shapes = _each(self.flexible.shape_covariance, shapes)
        return Weighted(vector, parts, shapes, others, by_shapes, _each(self.spread, others))

    def inner(self, first: Weighted, second: Weighted) -> np.ndarray:
        """Return v'(C + GG')^-1 w by amplitude: (T,)."""
        plain = first.vector @ second.vector - self.flexible.explained @ (first.parts * second.parts)
        return plain - (first.shapes * second.by_shapes).sum(axis=1) - (first.others * second.by_others).sum(axis=1)

    def condition(self, data: Weighted) -> tuple[np.ndarray, np.ndarray]:
        """Return the log evidence (T,) of data, and the means (T, p) of z given them."""
        mean = np.empty((len(self.spread), self.count))
        mean[:, self.columns] = data.by_others
        mean[:, self.flexible.columns] = data.by_shapes - _each(self.gains, data.by_others)
        return self.constants - 0.5 * self.inner(data, data), mean


def _each(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the products of matrices (T, a, b) with one vector each (T, b): (T, a)."""
    return np.matmul(matrices, vectors[:, :, None])[:, :, 0]
