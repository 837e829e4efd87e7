"""Chi-squared statistics: the tail of a quadratic form, the best of several tests, the mean of the smaller squares."""

from functools import cache

import numpy as np
from scipy import stats


def chi2_tail(covariance: np.ndarray, vector: np.ndarray) -> float:
    """Return the p-value of v' C^+ v against chi-squared with rank(C) degrees of freedom."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-6 * max(values[-1], 1e-300)
    rotated = vectors[:, kept].T @ vector
    return float(stats.chi2.sf(np.sum(rotated**2 / values[kept]), kept.sum()))


def best_of(z_scores: list[float]) -> float:
    """Return the standard normal number whose tail is n times that of the best of n score tests, or more.

    Bonferroni's bound, by the leading term of the tail.
    """
    return float(np.sqrt(max(max(z_scores) ** 2 - 2.0 * np.log(len(z_scores)), 0.0)))


def trimmed_mean_square(squares: np.ndarray, trimmed: float) -> float:
    """Return the mean square without the largest fraction, over that of standard normal numbers."""
    count = int(np.ceil((1.0 - trimmed) * squares.size))
    return float(np.sort(squares)[:count].mean()) / mean_of_smaller(count / squares.size)


@cache
def mean_of_smaller(fraction: float) -> float:
    """Return the mean of the smallest fraction of the squares of standard normal numbers."""
    return float(stats.chi2.cdf(stats.chi2.ppf(fraction, 1), 3)) / fraction
