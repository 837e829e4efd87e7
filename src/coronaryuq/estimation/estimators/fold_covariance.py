"""What a run in one fold does to the predictions in another: the covariance between folds that cross-fitting leaves.

Folds of a cross-fitted estimate are not independent: run l helps to predict run i, and run i to predict run l. With
a_il the change that run l makes to g(θ_i), less its mean over all θ, the second-order term of Hoeffding's
decomposition gives

    Σ_{i ≠ l} a_il a_li / (n (n − 1)),    at most Σ a_il² / (n (n − 1)) in size,

that var(residuals) / n falls short of the variance. It is of the order (effective parameters) / n: small for MFMC's one
coefficient, and not small for a Gaussian process on a small pilot, whose residuals are what it cannot know of a smooth
function. A leave-one-out update at fixed hyper-parameters gives a_il in closed form for least squares and Gaussian
processes alike: the weight of y_l in g(θ_i), times the leave-one-out residual of run l. Decomposition: Efron and Stein
1981.

Residuals of the pilot say nothing of places where it has no run. A pilot that by bad luck lacks a corner of the inputs
has small residuals and misses most in that corner. The control variate's own posterior variance knows it: `reach` is
its mean at the propagation samples over its mean at the held-out runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.estimation.surrogates.control_variates import Fitted, Seen

# Propagation samples per fold over which a change is averaged.
CENTRE = 50
# A pilot that happens to hold the hard corners has residuals larger than the rest: that counts, but only so far.
LEAST_REACH = 0.8


@dataclass(frozen=True)
class Between:
    """Of the mean of y − g, between folds: covariance, its bound, and what each run adds through others' g (n,).

    reach: expected square of y − g at the propagation samples over that at the pilot's runs; `LEAST_REACH` at least.
    """

    covariance: float
    bound: float
    indirect: np.ndarray
    reach: float = 1.0


@dataclass(frozen=True)
class Influence:
    """Changes of held-out predictions (n, n), of run i by run l; per fold those at some propagation samples (m, n), and
    the weights (m,) of these samples. variance (n,), variances (m,) per fold: of y given the prediction, there;
    without them the reach is not asked for."""

    fold: np.ndarray
    held: np.ndarray
    changes: list[np.ndarray]
    weights: list[np.ndarray]
    variance: np.ndarray | None = None
    variances: Sequence[np.ndarray] = ()

    def between(
        self, slope: np.ndarray | None = None, slopes: Sequence[np.ndarray] = (), shares: np.ndarray | None = None
    ) -> Between:
        """For the mean of y − h(g).

        slope (n,), slopes (m,) per fold: derivative of h at the held-out predictions and at the propagation samples,
        none for h = g. shares (n,): weights of runs, mean one.
        """
        at_samples = (
            self.changes if slope is None else [s[:, None] * c for s, c in zip(slopes, self.changes, strict=True)]
        )
        centre = np.array([w @ c / w.sum() for c, w in zip(at_samples, self.weights, strict=True)])
        a = (self.held if slope is None else slope[:, None] * self.held) - centre[self.fold]
        a = np.where(self.fold[:, None] == self.fold[None, :], 0.0, a)
        if shares is not None:
            a = a * shares[:, None]
        # A claim does not profit from a covariance below zero.
        pairs = len(a) * (len(a) - 1)
        both, bound = np.sum(a * a.T) / pairs, np.sum(a**2) / pairs
        return Between(max(0.0, float(both)), float(bound), a.sum(axis=0), self._reach(slope, slopes, shares))

    def _reach(self, slope, slopes, shares) -> float:
        if self.variance is None:
            return 1.0
        held = self.variance if slope is None else slope**2 * self.variance
        there = self.variances if slope is None else [s**2 * v for s, v in zip(slopes, self.variances, strict=True)]
        runs = np.bincount(self.fold, shares, len(there))
        wanted = np.average([np.average(v, weights=w) for v, w in zip(there, self.weights, strict=True)], weights=runs)
        found = np.average(held, weights=shares)
        return max(LEAST_REACH, float(wanted / found)) if found > 0 else 1.0


def changes(fitted: Fitted, seen: Seen, train: np.ndarray, n: int) -> np.ndarray:
    """Change (m, n) of the predictions at m samples by every pilot run, zero for those that are not in `train`."""
    found = np.zeros((len(seen), n))
    found[:, train] = fitted.influence(seen)
    return found
