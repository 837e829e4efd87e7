"""Joint covariance of estimates of several means from the same runs and propagation samples.

Each part of the variance of an estimate (3D residuals, propagation, dependence of samples) is a sum over samples, and
estimates of two quantities share the samples. A part of the covariance is therefore the correlation of the two
quantities' contributions, sample by sample, times the square roots of both parts. Its diagonal is the variance that
each estimate reports, and the sum of the parts is positive semi-definite, because every correlation matrix is.
"""

from collections.abc import Sequence

import numpy as np

from coronaryuq.estimation.estimators.crossfit import Estimate


def covariance(estimates: Sequence[Estimate]) -> np.ndarray:
    """Return the covariance (l, l) of the errors of l estimates of different means from the same samples.

    Parameters
    ----------
    estimates
        Estimates from one design, each of its own quantity.

    Returns
    -------
    numpy.ndarray
        Covariance (l, l), in products of the quantities' units.
    """
    seen = [estimate.contributions for estimate in estimates]
    pilot = np.column_stack([c.pilot for c in seen])
    # Plain Monte Carlo has no propagation samples.
    samples = max(len(c.propagated) for c in seen)
    more = np.column_stack([c.propagated if len(c.propagated) else np.zeros(samples) for c in seen])
    segments = next((c.segments for c in seen if c.segments is not None), None)
    chain = pilot if segments is None else _sums(more, segments.long)
    apart = np.array([c.apart for c in seen])
    residual, propagation, added = np.array(
        [[e.residual_variance, e.propagation_variance, e.chain_variance] for e in estimates]
    ).T
    return _scaled(pilot, residual) + _scaled(more, propagation - apart) + np.diag(apart) + _scaled(chain, added)


def _scaled(contributions: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return the covariance (l, l) that has the correlation of `contributions` (n, l) and the diagonal `variances`."""
    size = np.sqrt(np.sum(contributions**2, axis=0))
    unit = contributions / np.where(size > 0, size, 1.0)
    correlation = unit.T @ unit
    np.fill_diagonal(correlation, 1.0)
    roots = np.sqrt(variances)
    return correlation * np.outer(roots, roots)


def _sums(contributions: np.ndarray, segment: np.ndarray) -> np.ndarray:
    label = np.unique(segment, return_inverse=True)[1]
    return np.column_stack([np.bincount(label, column) for column in contributions.T])
