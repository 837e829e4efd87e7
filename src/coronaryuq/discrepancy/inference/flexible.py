"""Flexible discrepancy in the likelihood: evidence of a linearised model with an unknown error of any amplitude.

Whitened data e (N,) = G z + tau F w + noise, with z, w and the noise standard normal a priori (Kennedy & O'Hagan 2001).
The amplitude tau distinguishes two hypotheses about the same model:

- the model is right, within its own error: tau is small, half-normal about `MODEL_ERROR`, or zero;
- something else is missing: tau is at least twice that, of any size, uniformly in its logarithm.

F has independent blocks of rows, one per measured place and quantity, F = U S V', so that the covariance of the data
given z is I + tau^2 U S^2 U' and all amplitudes share one decomposition.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

AMPLITUDES = np.array([0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4])
"""Amplitudes as fractions of the largest value of a series."""
MODEL_ERROR = 0.005
"""Standard deviation of the error of a right model, as a fraction of the largest value of a series."""


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
    mean, covariance
        Of the parameters z: (T, p), (T, p, p).
    """

    log_evidence: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    def lowered(self, nats: float) -> "Posterior":
        """Return the posterior with all evidence lower by some nats."""
        return replace(self, log_evidence=self.log_evidence - nats)

    @property
    def right(self) -> float:
        """Log evidence of the model as right, within its own error."""
        return float(logsumexp(self.log_evidence + RIGHT))

    @property
    def unknown(self) -> float:
        """Log evidence of the model together with something else."""
        return float(logsumexp(self.log_evidence + UNKNOWN))

    @property
    def amplitude(self) -> float:
        """Most probable amplitude of something else."""
        return float(AMPLITUDES[int(np.argmax(self.log_evidence + UNKNOWN))])

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (p,) and covariance (p, p) of z, averaged over the amplitudes of a right model."""
        weights = np.exp(self.log_evidence + RIGHT - self.right)
        mean = weights @ self.mean
        moved = self.mean - mean
        return mean, np.einsum("t,tij->ij", weights, self.covariance) + np.einsum("t,ti,tj->ij", weights, moved, moved)


class Flexible:
    """Decomposition of the features of some rows, shared by all models of these rows.

    Parameters
    ----------
    features
        Whitened features of unit amplitude: (N, k).
    blocks
        Number of the independent block of each row: (N,). Features of different blocks have no common column.
    """

    def __init__(self, features: np.ndarray, blocks: np.ndarray):
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
        self.log_determinant = np.log1p(spread).sum(axis=1)

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
        return Posterior(*model.condition(model.weighted(at_zero)), model.covariance)


@dataclass(frozen=True)
class Weighted:
    """A vector v (N,) weighted by the covariance C of each amplitude.

    vector: v; parts: its components (k,); cross: G'C^-1 v (T, p).
    """

    vector: np.ndarray
    parts: np.ndarray
    cross: np.ndarray


class Projection:
    """Sensitivities G (N, p) of a model under every amplitude, for inner products v'(C + GG')^-1 w."""

    def __init__(self, flexible: Flexible, jacobian: np.ndarray):
        self.flexible, self.jacobian = flexible, jacobian
        self.parts = flexible.along(jacobian)
        inner = np.eye(jacobian.shape[1]) + jacobian.T @ jacobian
        precision = np.array([inner - (self.parts.T * share) @ self.parts for share in flexible.explained])
        self.covariance = np.linalg.inv(precision)
        """Posterior covariances of z by amplitude: (T, p, p)."""
        self.constants = -0.5 * (np.linalg.slogdet(precision)[1] + flexible.log_determinant)
        """Terms of the log evidence that do not depend on the data: (T,)."""

    def weighted(self, vector: np.ndarray) -> Weighted:
        """Return the products of a vector (N,) with the sensitivities."""
        parts = self.flexible.along(vector[:, None])[:, 0]
        return Weighted(vector, parts, self.jacobian.T @ vector - (self.flexible.explained * parts) @ self.parts)

    def inner(self, first: Weighted, second: Weighted) -> np.ndarray:
        """Return v'(C + GG')^-1 w by amplitude: (T,)."""
        plain = first.vector @ second.vector - self.flexible.explained @ (first.parts * second.parts)
        return plain - np.einsum("ti,tij,tj->t", first.cross, self.covariance, second.cross, optimize=True)

    def condition(self, data: Weighted) -> tuple[np.ndarray, np.ndarray]:
        """Return the log evidence (T,) of data, and the means (T, p) of z given them."""
        mean = np.einsum("tij,tj->ti", self.covariance, data.cross)
        return self.constants - 0.5 * self.inner(data, data), mean
