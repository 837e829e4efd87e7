"""The covariance between folds that cross-fitting leaves: each run influences the predictions in other folds.

Folds of a cross-fitted estimate are not independent: run l helps to predict run i, and run i to predict run l. With
a_il the influence of run l on g(θ_i), minus its mean over all θ, the second-order term of Hoeffding's decomposition
gives

    Σ_{i ≠ l} a_il a_li / (n (n − 1)),    at most Σ a_il² / (n (n − 1)) in size,

that var(residuals) / n falls short of the variance. It is of the order (effective parameters) / n: small for MFMC's one
coefficient, but not for a Gaussian process on a small pilot, whose residuals are interpolation errors of a smooth
function. A leave-one-out update at fixed hyper-parameters gives a_il in closed form for least squares and Gaussian
processes alike: the weight of y_l in g(θ_i), times the leave-one-out residual of run l. Decomposition: Efron and Stein
1981.

Residuals of the pilot hold no information on places where it has no run. A pilot that by bad luck lacks a corner of the
inputs has small residuals, but large errors in that corner. The control variate's own posterior variance shows it:
`reach` is its mean at the propagation samples over its mean at the held-out runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.estimation.surrogates.control_variates import Fitted, Seen

# Propagation samples per fold over which a change is averaged.
CENTRE = 50
# A pilot that happens to hold the hard corners has larger residuals than the rest: this counts, but only so far.
LEAST_REACH = 0.8


@dataclass(frozen=True)
class Between:
    """Of the mean of y − g: covariance between folds, its bound, and each run's effect through others' g (n,).

    reach: expected square of y − g at the propagation samples over that at the pilot's runs; `LEAST_REACH` at least.
    """

    covariance: float
    bound: float
    indirect: np.ndarray
    reach: float = 1.0


@dataclass(frozen=True)
class Influence:
    """Influence of every pilot run on the predictions.

    Parameters
    ----------
    fold
        Fold (n,) of each pilot run.
    held
        Change (n, n) of the held-out prediction of run i by run l.
    changes, weights
        Per fold, changes (m, n) at some propagation samples, and the weights (m,) of these samples.
    variance, variances
        Variance of y given the prediction at the held-out runs (n,), and per fold at the propagation samples (m,);
        without them the reach is 1.
    """

    fold: np.ndarray
    held: np.ndarray
    changes: list[np.ndarray]
    weights: list[np.ndarray]
    variance: np.ndarray | None = None
    variances: Sequence[np.ndarray] = ()

    def between(
        self, slope: np.ndarray | None = None, slopes: Sequence[np.ndarray] = (), shares: np.ndarray | None = None
    ) -> Between:
        """Return covariance and reach for the mean of y − h(g).

        Parameters
        ----------
        slope, slopes
            Derivative of h at the held-out predictions (n,), and per fold at the propagation samples (m,); None for
            h = g.
        shares
            Weights (n,) of runs, mean one; equal if None.

        References
        ----------
        Efron and Stein, "The jackknife estimate of variance", Annals of Statistics 9, 1981.
        """
        at_samples = (
            self.changes if slope is None else [s[:, None] * c for s, c in zip(slopes, self.changes, strict=True)]
        )
        centre = np.array([w @ c / w.sum() for c, w in zip(at_samples, self.weights, strict=True)])
        a = (self.held if slope is None else slope[:, None] * self.held) - centre[self.fold]
        a = np.where(self.fold[:, None] == self.fold[None, :], 0.0, a)
        if shares is not None:
            a = a * shares[:, None]
        # A negative covariance does not reduce the claim.
        pairs = len(a) * (len(a) - 1)
        both, bound = np.sum(a * a.T) / pairs, np.sum(a**2) / pairs
        return Between(max(0.0, float(both)), float(bound), a.sum(axis=0), self._reach(slope, slopes, shares))

    def _reach(self, slope: np.ndarray | None, slopes: Sequence[np.ndarray], shares: np.ndarray | None) -> float:
        if self.variance is None:
            return 1.0
        held = self.variance if slope is None else slope**2 * self.variance
        there = self.variances if slope is None else [s**2 * v for s, v in zip(slopes, self.variances, strict=True)]
        runs = np.bincount(self.fold, shares, len(there))
        wanted = np.average([np.average(v, weights=w) for v, w in zip(there, self.weights, strict=True)], weights=runs)
        at_runs = np.average(held, weights=shares)
        return max(LEAST_REACH, float(wanted / at_runs)) if at_runs > 0 else 1.0


def changes(fitted: Fitted, seen: Seen, train: np.ndarray, n: int) -> np.ndarray:
    """Return the change (m, n) of predictions at m samples by each of n pilot runs, zero for those not in `train`."""
    change = np.zeros((len(seen), n))
    change[:, train] = fitted.influence(seen)
    return change
