"""Cross-fitted estimate of a mean: a surrogate predicts only folds that it was not fitted on.

The reported variance is therefore valid.

With folds k of n_k runs, g_k fitted without fold k, and a block B_k of propagation samples that belongs to fold k,

    estimate = Σ_k n_k / n · [ mean_{i in k} (y_i − β g_k(θ_i)) + β mean_{j in B_k} g_k(θ_j) ]

is unbiased for any g_k, because g_k depends on neither the runs of fold k nor the samples of B_k. Its variance is
estimated by R var(residuals) / n + β² R C + β² Σ_k (n_k / n)² var(g_k on B_k) / |B_k|, with the covariance C between
folds and the extrapolation factor R of module `influence`. Each propagation sample serves one fold only, which costs
nothing: K blocks of M / K samples have together the variance of M samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.estimation.estimators import dependence
from coronaryuq.estimation.estimators.dependence import INDEPENDENT, Dependence, Segments
from coronaryuq.estimation.estimators.formulas import correlation
from coronaryuq.estimation.estimators.influence import Between
from coronaryuq.estimation.estimators.quantile import Part, kurtosis_freedom, skewness, two_sided
from coronaryuq.estimation.results import Interval

# How far the interval's variance goes from the covariance between folds to that covariance's bound.
TO_BOUND = 0.25


@dataclass(frozen=True)
class Propagated:
    """g_k on a block of propagation samples: values (m_k,).

    `integrated`: predictions behind each value, 1 for a plain sample, more where a known input was integrated exactly.
    at: samples with predictions, where a regression carried these over to the others (`regression`); 0 for all.
    `also`: values on further, independent samples, whose means add to this one. segments: of the values, where their
    samples depend on each other.
    """

    values: np.ndarray
    integrated: int = 1
    also: tuple[np.ndarray, ...] = ()
    segments: Segments | None = None
    at: int = 0

    @property
    def mean(self) -> float:
        return float(self.values.mean() + sum(v.mean() for v in self.also))

    @property
    def variance(self) -> float:
        """Of the mean; a single value counts as known exactly."""
        return float(sum(np.var(v, ddof=1) / len(v) for v in (self.values, *self.also) if len(v) > 1))

    @property
    def predictions(self) -> int:
        return self.integrated * ((self.at or len(self.values)) + sum(len(v) for v in self.also))


@dataclass(frozen=True)
class CrossFit:
    """A quantity and its cross-fitted control variate.

    y (n,): outputs of the pilot runs. held_out (n,): g at each of them, fitted without its fold. blocks:
    g at the propagation samples, in fold order. fold (n,): fold of each pilot run. dependence: of the samples on
    each other.
    """

    y: np.ndarray
    held_out: np.ndarray
    blocks: Sequence[Propagated]
    fold: np.ndarray
    dependence: Dependence = INDEPENDENT


@dataclass(frozen=True)
class Options:
    """How a cross-fitted mean is combined and how its variance is estimated.

    level: of the calibrated interval. beta: coefficient of the control variate; None takes the value that minimises
    the variance for a g that is the conditional mean of y, which depends on g alone and not on y. weights (n,), mean
    one: correct a pilot whose inputs are not distributed as the propagation samples. between: what folds have in
    common, for a g whose fit has more than a few parameters. expected, trust: a variance that the residuals' part
    should have, and how far (0 to 1) it replaces the estimated one. target: number of propagation samples where these
    are the finite set whose mean is wanted rather than a sample of a law; their own residuals are then part of the
    error. in_order: the control variate was propagated at the design's samples, in the order of its blocks.
    """

    level: float = 0.95
    beta: float | None = None
    weights: np.ndarray | None = None
    between: Between | None = None
    expected: float = 0.0
    trust: float = 0.0
    target: int = 0
    in_order: bool = True


PLAIN = Options()


@dataclass(frozen=True)
class Contributions:
    """What each pilot run (n,) and propagation sample (m,) adds to an estimate, less the mean of its kind.

    apart: variance of what comes from samples that other estimates do not use in the same order. dependence: of the
    samples on each other. segments: of the propagation samples, if they depend on each other.
    """

    pilot: np.ndarray
    propagated: np.ndarray
    apart: float = 0.0
    dependence: Dependence = INDEPENDENT
    segments: Segments | None = None

    def __sub__(self, other: "Contributions") -> "Contributions":
        """Return the contributions to the difference of two estimates from the same samples."""
        sizes = len(self.propagated), len(other.propagated)
        a, b = (
            np.zeros(max(sizes)) if not size else c.propagated for c, size in zip((self, other), sizes, strict=True)
        )
        segments = self.segments or other.segments
        return Contributions(self.pilot - other.pilot, a - b, self.apart + other.apart, self.dependence, segments)

    @property
    def variance(self) -> float:
        """Of the sum of all contributions, without an error that pilot and propagation have in common."""
        n = len(self.pilot)
        pilot, more = float(np.sum(self.pilot**2) * n / (n - 1)), float(np.sum(self.propagated**2))
        pilot = max(pilot, dependence.variance([(self.pilot, self.dependence.pilot)])[0])
        if not self.dependence.shared:
            more = max(more, dependence.variance([(self.propagated, self.segments)])[0])
        return pilot + more + self.apart


@dataclass(frozen=True)
class Estimate:
    """A mean with its reported standard error, and the quantities by which to judge it.

    The variance has three parts: of the 3D residuals, of propagation, and what their samples' dependence on each other
    adds to both (`chain_variance`).
    contributions: of the single samples. skewness: of the estimate, from the third moments of its contributions.
    sound: no warning speaks against recommending it.
    rho_in_sample, std_in_sample: correlation and standard error of the same method fitted and evaluated on all runs, as
    the paper prints them, where they were computed.
    """

    method: str
    mean: float
    std: float
    rho_held_out: float
    n_3d: int
    n_0d: int
    predictions: int
    beta: float
    interval: Interval
    residual_variance: float
    propagation_variance: float
    chain_variance: float
    residuals: np.ndarray = field(repr=False)
    contributions: Contributions = field(repr=False)
    skewness: float
    rho_in_sample: float | None = None
    std_in_sample: float | None = None
    warnings: tuple[str, ...] = ()
    sound: bool = True

    def warned(self, text: object | None, blocks: bool = False) -> "Estimate":
        """Return the estimate with one more warning, unsound if that blocks it; unchanged for None."""
        if text is None:
            return self
        return replace(self, warnings=(*self.warnings, str(text)), sound=self.sound and not blocks)


def combine(method: str, fit: CrossFit, n_0d: int, options: Options = PLAIN) -> Estimate:
    """Return the cross-fitted estimate of the mean of y.

    The interval is Student's t. Its variance carries the covariance between folds a quarter of the way to its bound,
    because the refit of hyper-parameters is not in it. Its degrees of freedom follow from the fourth moment of the
    residuals, with what each run adds through the others' g (Satterthwaite 1946), because the variance of long-tailed
    residuals is known less well than that of a normal sample; and it is widened by what the skewness of the estimate
    takes from its coverage (module `quantile`).

    Parameters
    ----------
    method
        Name of the estimator.
    fit
        The quantity and its control variate.
    n_0d
        0D runs behind the estimate.
    options
        Coefficient, weights and corrections of the variance.

    Returns
    -------
    Estimate
        Mean, standard error and interval, in the unit of y.

    References
    ----------
    Satterthwaite, "An approximate distribution of estimates of variance components", Biometrics Bulletin 2, 1946.
    """
    y, held_out, blocks, fold, n = fit.y, fit.held_out, fit.blocks, fit.fold, len(fit.y)
    between, expected, trust, target = options.between, options.expected, options.trust, options.target
    weights = np.ones(n) if options.weights is None else options.weights
    share = np.array([weights[fold == k].sum() for k in range(len(blocks))]) / weights.sum()
    from_blocks = 0.0 if target else float(sum(s**2 * b.variance for s, b in zip(share, blocks, strict=True)))
    spread = np.var(held_out, ddof=1) if n > 1 else 0.0
    along = [] if target else [_contributions(b, s) for b, s in zip(blocks, share, strict=True)]
    whole, freedom = dependence.variance(along)
    beyond = max(0.0, whole - from_blocks)  # what dependence adds to the variance of the propagation means
    beta, chosen = options.beta, Part(0.0, np.inf)
    if beta is None:
        beta, chosen = _coefficient(fit, spread / n, from_blocks, (beyond, freedom))
    residuals = y - beta * held_out
    mean = float(np.average(residuals, weights=weights))
    mean += beta * float(sum(s * b.mean for s, b in zip(share, blocks, strict=True)))
    centred = residuals - np.average(residuals, weights=weights)
    estimated = float(np.sum((weights * centred) ** 2) / weights.sum() ** 2 * n / (n - 1))
    from_residuals = (1 - trust) * estimated + trust * expected
    from_blocks = beta**2 * from_blocks
    values, covariance, towards = weights * centred, 0.0, 0.0
    if between is not None:
        values = values - beta * between.indirect
        factor = _extrapolated(between.extrapolation_factor, estimated, weights * (y - np.average(y, weights=weights)))
        from_residuals *= factor
        covariance, bound = (beta**2 * factor * part for part in (between.covariance, between.bound))
        towards = TO_BOUND * max(0.0, bound - covariance)
    from_residuals += covariance + (from_residuals * n / target if target else 0.0)
    chain = [*_chain_variance(fit, weights * centred / weights.sum(), estimated, beta, (beyond, freedom)), chosen]
    from_chain = sum(part.variance for part in chain)
    std = (from_residuals + from_blocks + from_chain) ** 0.5
    bound = from_residuals + towards
    parts = [Part(bound - trust * expected, kurtosis_freedom(values)), *chain]
    total = bound + from_blocks + from_chain
    shared_samples = along if beta and options.in_order else []
    propagated = beta * np.concatenate([np.empty(0), *(values for values, _ in shared_samples)])
    apart = max(0.0, from_blocks - float(np.sum(propagated**2)))
    skewed = skewness([values / n, propagated], total)
    half = two_sided(options.level, parts, from_blocks + trust * expected, n, skewed) * total**0.5
    segments = [s for _, s in shared_samples if s is not None]
    return Estimate(
        method, mean, std, correlation(y, held_out), n, n_0d, sum(b.predictions for b in blocks), beta,
        Interval(mean - half, mean + half, options.level), from_residuals, from_blocks, from_chain, residuals,
        Contributions(
            weights * centred / weights.sum(), propagated, apart, fit.dependence,
            dependence.joined(segments) if segments else None,
        ), skewed,
    )  # fmt: skip


def propagation_variance(blocks: Sequence[Propagated], share: np.ndarray) -> float:
    """Return the variance of the blocks' means, weighted by the fraction (k,) of each, with what dependence adds."""
    alone = float(sum(s**2 * b.variance for s, b in zip(share, blocks, strict=True)))
    along = [_contributions(b, s) for b, s in zip(blocks, share, strict=True)]
    return max(alone, dependence.variance(along)[0])


def _contributions(block: Propagated, share: float) -> tuple[np.ndarray, Segments | None]:
    """Return the contributions (m,) of a block's values to the estimate, less their mean, and their segments."""
    return share * (block.values - block.values.mean()) / len(block.values), block.segments


def _extrapolated(factor: float, estimated: float, deviations: np.ndarray) -> float:
    """Return the factor of the residuals' variance, such that it is not above that of y by itself.

    In a corner without runs a conditional mean misses no more of y than the mean of y does, on average. A larger factor
    comes from two rivals that are far apart there, not from an expected error.

    Parameters
    ----------
    factor
        Expected square of y − g at the propagation samples over that at the pilot's runs.
    estimated
        Variance of the mean of the residuals.
    deviations
        Weighted deviations (n,) of y from its mean.
    """
    if factor <= 1 or estimated == 0:
        return factor
    n = len(deviations)
    alone = float(np.sum(deviations**2)) / (n * (n - 1))
    return min(factor, max(1.0, alone / estimated))


def _coefficient(fit: CrossFit, alone: float, from_blocks: float, beyond: tuple[float, float]) -> tuple[float, Part]:
    """Return the coefficient of least variance, and the variance that choosing it from these samples hides.

    With variances A and B of the mean of g over pilot and propagation samples, β = A / (A + B), and the control
    variate adds A B / (A + B). From segments A and B are known with few degrees of freedom a and b. The minimum of an
    uncertain variance is too low, to first order by (A + B) (β − β²)² (2/a + 2/b), and the coefficient's own error
    raises the variance by as much. Of independent samples a is n − 1: that is less than 1 / n of the variance, and left
    out.
    """
    segments, shared = fit.dependence.pilot, fit.dependence.shared
    along, freedom = dependence.variance([((fit.held_out - fit.held_out.mean()) / len(fit.y), segments)])
    here, there = max(alone, along), from_blocks + (0.0 if shared else beyond[0])
    if here == 0:
        return 0.0, Part(0.0, np.inf)
    beta = float(here / (here + there))
    known = [freedom, np.inf if shared else beyond[1]]
    hidden = 2 * (beta * (1 - beta)) ** 2 * (here + there) * sum(2 / degrees for degrees in known)
    return beta, Part(hidden, min(known))


def _chain_variance(
    fit: CrossFit, contributions: np.ndarray, estimated: float, beta: float, beyond: tuple[float, float]
) -> list[Part]:
    """Return what dependence adds to the variance of an estimate.

    The error of a chain that pilot and propagation share is that of the chain's mean of y, which is that of g and of
    y − g. Where propagation has no segments, all of it is taken from y.
    """
    added, freedom = beyond
    if fit.dependence.shared:
        seen = beta > 0 and any(block.segments is not None for block in fit.blocks)
        unexplained = float(np.var(fit.y - seen * fit.held_out, ddof=1))
        common = fit.dependence.in_common(beta) if seen else 1.0
        return [Part(common * added, freedom), Part(unexplained * fit.dependence.ratio, np.inf)]
    of_pilot, freedom_of_pilot = dependence.variance([(contributions, fit.dependence.pilot)])
    return [Part(beta**2 * added, freedom), Part(max(0.0, of_pilot - estimated), freedom_of_pilot)]
