"""The covariance between folds that cross-fitting leaves: each run influences the predictions in other folds.

Folds of a cross-fitted estimate are not independent: run l helps to predict run i, and run i to predict run l. Let
a_il be the influence of run l on g(θ_i), minus its mean over all θ. By the second-order term of Hoeffding's
decomposition, the variance of the estimate exceeds var(residuals) / n by

    Σ_{i ≠ l} a_il a_li / (n (n − 1)),    at most Σ a_il² / (n (n − 1)) in size.

This is of the order (effective parameters) / n: small for MFMC's one
coefficient, but not for a Gaussian process on a small pilot, whose residuals are interpolation errors of a smooth
function. A leave-one-out update at fixed hyper-parameters gives a_il in closed form for least squares and Gaussian
processes alike: the weight of y_l in g(θ_i), times the leave-one-out residual of run l. Decomposition: Efron and Stein
1981.

Residuals of the pilot are not informative about regions without runs. A pilot that by chance lacks a corner of the
inputs has small residuals, but large errors in that corner. The posterior variance of the control variate reveals this:
`extrapolation_factor` is its mean at the propagation samples over its mean at the held-out runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.estimation.surrogates.control_variates import Fitted, Seen

# Propagation samples per fold over which a change is averaged.
CENTRE = 50
# A pilot that happens to contain the difficult corners has larger residuals than the rest: the factor is below 1, but
# at least this.
MIN_EXTRAPOLATION_FACTOR = 0.8


@dataclass(frozen=True)
class Between:
    """Of the mean of y − g: covariance between folds, its bound, and each run's effect through others' g (n,).

    extrapolation_factor: expected square of y − g at the propagation samples over that at the pilot's runs;
    `MIN_EXTRAPOLATION_FACTOR` at least.
    """

    covariance: float
    bound: float
    indirect: np.ndarray
    extrapolation_factor: float = 1.0


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
        without them the extrapolation factor is 1.
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
        """Return covariance and extrapolation factor for the mean of y − h(g).

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
        # A negative covariance does not reduce the reported standard error.
        pairs = len(a) * (len(a) - 1)
        both, bound = np.sum(a * a.T) / pairs, np.sum(a**2) / pairs
        return Between(
            max(0.0, float(both)), float(bound), a.sum(axis=0), self._extrapolation_factor(slope, slopes, shares)
        )

    def _extrapolation_factor(
        self, slope: np.ndarray | None, slopes: Sequence[np.ndarray], shares: np.ndarray | None
    ) -> float:
        if self.variance is None:
            return 1.0
        held = self.variance if slope is None else slope**2 * self.variance
        there = self.variances if slope is None else [s**2 * v for s, v in zip(slopes, self.variances, strict=True)]
        runs = np.bincount(self.fold, shares, len(there))
        at_samples = np.average(
            [np.average(v, weights=w) for v, w in zip(there, self.weights, strict=True)], weights=runs
        )
        at_runs = np.average(held, weights=shares)
        return max(MIN_EXTRAPOLATION_FACTOR, float(at_samples / at_runs)) if at_runs > 0 else 1.0


def changes(fitted: Fitted, seen: Seen, train: np.ndarray, n: int) -> np.ndarray:
    """Return the change (m, n) of predictions at m samples by each of n pilot runs, zero for those not in `train`."""
    change = np.zeros((len(seen), n))
    change[:, train] = fitted.influence(seen)
    return change
