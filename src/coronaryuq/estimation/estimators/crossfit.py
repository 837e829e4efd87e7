"""Cross-fitted estimate of a mean: what is fitted on some folds is used on the others only, so the claimed variance
is true.

With folds k of n_k runs, g_k fitted without fold k, and a block B_k of propagation samples that belongs to fold k,

    estimate = Σ_k n_k / n · [ mean_{i in k} (y_i − β g_k(θ_i)) + β mean_{j in B_k} g_k(θ_j) ]

is unbiased whatever g_k is, because g_k knows neither the runs of fold k nor the samples of B_k. Its variance is
estimated by R var(residuals) / n + β² R C + β² Σ_k (n_k / n)² var(g_k on B_k) / |B_k| with the covariance C between
folds and the reach R that module `influence` finds. Each propagation sample serves one fold only, which costs nothing:
K blocks of M / K samples have together the variance of M samples.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtrit

from coronaryuq.estimation.estimators.fold_covariance import Between
from coronaryuq.estimation.estimators.montecarlo import Interval, correlation

# How far the interval's variance goes from the covariance between folds to that covariance's bound.
TO_BOUND = 0.25


@dataclass(frozen=True)
class Propagated:
    """g_k on a block of propagation samples: values (m_k,) and the variance (before division by m_k) that counts.

    `integrated`: predictions behind each value, 1 for a plain sample, more where a known input was integrated exactly.
    `also`: values on further, independent samples, whose means add to this one.
    """

    values: np.ndarray
    integrated: int = 1
    also: tuple[np.ndarray, ...] = ()

    @property
    def mean(self) -> float:
        return float(self.values.mean() + sum(v.mean() for v in self.also))

    @property
    def variance(self) -> float:
        """Of the mean; a single value counts as known exactly."""
        return float(sum(np.var(v, ddof=1) / len(v) for v in (self.values, *self.also) if len(v) > 1))

    @property
    def predictions(self) -> int:
        return self.integrated * (len(self.values) + sum(len(v) for v in self.also))


@dataclass(frozen=True)
class Estimate:
    """A mean with its claimed standard deviation and what is needed to judge it."""

    method: str
    mean: float
    std: float
    rho_held_out: float
    n_3d: int
    n_0d: int
    predictions: int
    beta: float
    interval: Interval
    warnings: tuple[str, ...] = ()
    residual_variance: float = 0.0
    propagation_variance: float = 0.0
    residuals: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)


def combine(
    method: str, y: np.ndarray, held_out: np.ndarray, blocks: list[Propagated], fold: np.ndarray,
    n_0d: int, level: float = 0.95, beta: float | None = None, weights: np.ndarray | None = None,
    between: Between | None = None, expected: float = 0.0, trust: float = 0.0, target: int = 0,
) -> Estimate:  # fmt: skip
    """Cross-fitted estimate from y (n,), held-out g (n,), blocks of propagation values in fold order, fold (n,).

    beta None takes the value that minimises the variance for a g that is the conditional mean of y: it depends on g
    alone, not on y. weights (n,), mean one, correct a pilot whose inputs are not distributed as the propagation
    samples. between: what folds have in common, for a g whose fit has more than a few parameters. expected, trust: a
    variance that the residuals' part should have, and how far (0 to 1) it takes the place of the one found. target:
    number of propagation samples where these are the finite set whose mean is wanted, and no sample of a law; their
    own residuals are then part of the error.

    The interval is Student's t. Its variance carries the covariance between folds a quarter of the way to its bound,
    because the refit of hyper-parameters is not in it; its degrees of freedom follow from the fourth moment of the
    residuals, with what each run adds through the others' g (Satterthwaite 1946), because the variance of long-tailed
    residuals is known less well than that of a normal sample.
    """
    n = len(y)
    weights = np.ones(n) if weights is None else weights
    share = np.array([weights[fold == k].sum() for k in range(len(blocks))]) / weights.sum()
    from_blocks = 0.0 if target else float(sum(s**2 * b.variance for s, b in zip(share, blocks, strict=True)))
    spread = np.var(held_out, ddof=1) if n > 1 else 0.0
    if beta is None:
        beta = float(spread / n / (spread / n + from_blocks)) if spread > 0 else 0.0
    residuals = y - beta * held_out
    mean = float(np.average(residuals, weights=weights))
    mean += beta * float(sum(s * b.mean for s, b in zip(share, blocks, strict=True)))
    centred = residuals - np.average(residuals, weights=weights)
    found = float(np.sum((weights * centred) ** 2) / weights.sum() ** 2 * n / (n - 1))
    from_residuals = (1 - trust) * found + trust * expected
    from_blocks = beta**2 * from_blocks
    values, covariance, towards = weights * centred, 0.0, 0.0
    if between is not None:
        values = values - beta * between.indirect
        from_residuals *= between.reach
        covariance, bound = (beta**2 * between.reach * part for part in (between.covariance, between.bound))
        towards = TO_BOUND * max(0.0, bound - covariance)
    from_residuals += covariance + (from_residuals * n / target if target else 0.0)
    bound = from_residuals + towards
    std = (from_residuals + from_blocks) ** 0.5
    well_known = from_blocks + trust * expected
    half = _quantile(values, bound - trust * expected, well_known, level) * (bound + from_blocks) ** 0.5
    return Estimate(
        method, mean, std, correlation(y, held_out), n, n_0d, sum(b.predictions for b in blocks), beta,
        Interval(mean - half, mean + half, level), residual_variance=from_residuals,
        propagation_variance=from_blocks, residuals=residuals,
    )  # fmt: skip


def _quantile(values: np.ndarray, from_values: float, rest: float, level: float) -> float:
    """Student's two-sided quantile for a variance of which a part comes from `values` (n,), the rest is known well."""
    n = len(values)
    spread = np.var(values)
    if spread == 0 or from_values == 0:
        return float(stdtrit(n - 1, (1 + level) / 2))
    kurtosis = np.mean(((values - values.mean()) / spread**0.5) ** 4)
    freedom = min(n - 1, max(2.0, 2 * n / max(kurtosis - 1, 1e-9)))
    return float(stdtrit(freedom * ((from_values + rest) / from_values) ** 2, (1 + level) / 2))
