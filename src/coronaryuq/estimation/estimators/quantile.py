"""Two-sided quantile of an estimate whose variance has several parts and whose contributions are skewed.

With S the skewness of the estimate, the coverage of an interval of q standard errors to either side is, to first order,
that of Student's t less 2 q φ(q) S² (q⁴ + 2 q² − 3) / 18 (Hall 1992, section 2.6): the standard error of a long-tailed
sample is too small just where its mean is too low. The quantile is the q that makes up for this.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit


@dataclass(frozen=True)
class Part:
    """A part of a variance, and the degrees of freedom with which it is known."""

    variance: float
    freedom: float


def kurtosis_freedom(values: np.ndarray) -> float:
    """Return the degrees of freedom of the variance of `values` (n,), from their fourth moment (Satterthwaite 1946)."""
    spread = np.var(values)
    if not spread > 0:
        return np.inf
    kurtosis = np.mean(((values - values.mean()) / spread**0.5) ** 4)
    return float(min(len(values) - 1, max(2.0, 2 * len(values) / max(kurtosis - 1, 1e-9))))


def skewness(contributions: Sequence[np.ndarray], variance: float) -> float:
    """Return the skewness of a sum of independent contributions of mean zero that has a variance."""
    return float(sum(np.dot(c * c, c) for c in contributions) / variance**1.5) if variance > 0 else 0.0


def lost_coverage(skewed: float, q: float) -> float:
    """Return what skewness takes from the coverage of an interval of q standard errors to either side."""
    density = np.exp(-(q**2) / 2) / np.sqrt(2 * np.pi)
    return float(2 * q * density * skewed**2 * (q**4 + 2 * q**2 - 3) / 18)


def two_sided(level: float, parts: Sequence[Part], rest: float, n: int, skewed: float = 0.0) -> float:
    """Return the quantile, in standard errors.

    Parameters
    ----------
    level
        Of the interval.
    parts, rest
        Parts of the variance that are known from few samples, and the part that is known well.
    n
        Number of samples, where no part is uncertain.
    skewed
        Skewness of the estimate.
    """
    uncertain = [part for part in parts if part.variance > 0]
    total = sum(part.variance for part in uncertain) + rest
    inverse = sum((part.variance / total) ** 2 / part.freedom for part in uncertain)
    freedom = 1 / inverse if inverse > 0 else np.inf if uncertain else n - 1
    plain = float(stdtrit(min(freedom, 1e9), (1 + level) / 2))

    def excess(q: float) -> float:
        return float(2 * stdtr(min(freedom, 1e9), q) - 1 - lost_coverage(skewed, q) - level)

    # Beyond eight standard errors the expansion says nothing: a sample that skewed gets a warning.
    return float(brentq(excess, plain, 8.0)) if excess(plain) < 0 < excess(8.0) else plain
