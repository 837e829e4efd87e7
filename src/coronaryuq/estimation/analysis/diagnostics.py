"""Checks for estimates that would be silently wrong: each is reported, and corrected or dropped by a stated rule."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import ndtri

from coronaryuq.core.units import percent
from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.dependence import INDEPENDENT, Dependence, Segments, variance
from coronaryuq.estimation.estimators.quantile import lost_coverage
from coronaryuq.estimation.runs.table import Runs

# Tests at 0.1 %, Bonferroni-corrected over inputs: one false warning in a thousand campaigns.
SIGNIFICANCE = 1e-3
OUTSIDE_SHARE, DOMINANT_SHARE = 0.05, 0.5
# If the 5 % of coarse runs with the largest quantity fail, the reported standard error is 0.91 of the empirical one;
# if 20 % do, 0.86.
COARSE_FAILED = 0.05
# A 95 % interval may cover 93 %. The skewness of a sample from a long-tailed law is about half that of the law, so a
# warning is due from half of these two points on.
LOST = 0.01
# Runs unlike all the others, at most, for a quantity to be called constant; part of the inputs that may go unseen.
FEW, UNSEEN = 2, 0.03
# Standard errors of the difference of two estimates.
DISAGREE = 3.0


@dataclass(frozen=True)
class Finding:
    """One warning: a code that begins its line, one line for the reader, and the rule that was applied.

    blocks: an estimator with this warning is not recommended.
    """

    code: str
    text: str
    rule: str
    blocks: bool = False

    def __str__(self) -> str:
        return f"{self.code}: {self.text} ({self.rule})"


def different_inputs(runs: Runs, dependence: Dependence = INDEPENDENT) -> Finding | None:
    """Compare pilot and propagation inputs: Kolmogorov-Smirnov and Welch's test of log θ, input by input.

    Samples that depend on each other count with their effective number.
    """
    if len(runs.theta_more) < 8:
        return None
    a, b = runs.coordinates(runs.theta), runs.coordinates(runs.theta_more)
    p = {runs.inputs[j]: _same_law(a[:, j], b[:, j], dependence) for j in range(a.shape[1]) if np.ptp(b[:, j]) > 0}
    low = {name: value for name, value in p.items() if value * 2 * len(p) < SIGNIFICANCE}
    if not low:
        return None
    worst = min(low, key=lambda name: low[name])
    return Finding(
        "inputs differ",
        f"pilot and propagation inputs are not identically distributed: {len(low)} of {len(p)} inputs differ, mainly "
        f"{worst} (p = {low[worst]:.1e})",
        "the propagation sample is the target; pilot runs are reweighted to its means in every estimate",
    )


def _same_law(a: np.ndarray, b: np.ndarray, dependence: Dependence) -> float:
    """Return the smaller p of two tests that samples (n,), (m,) have one law."""
    if dependence.pilot is None and dependence.more is None:
        return float(min(stats.ks_2samp(a, b).pvalue, stats.ttest_ind(a, b, equal_var=False).pvalue))
    (n, of_a), (m, of_b) = _effective(a, dependence.pilot), _effective(b, dependence.more)
    distance = stats.ks_2samp(a, b, method="asymp").statistic * np.sqrt(n * m / (n + m))
    freedom = max(1.0, min(n, m) - 1)
    means = 2 * stats.t.sf(abs(a.mean() - b.mean()) / np.sqrt(of_a + of_b), freedom)
    return float(min(stats.kstwobign.sf(distance), means))


def _effective(values: np.ndarray, segments: Segments | None) -> tuple[float, float]:
    """Return the effective number of samples and the variance of their mean."""
    n, independent = len(values), float(np.var(values, ddof=1)) / len(values)
    of_mean = max(independent, variance([((values - values.mean()) / n, segments)])[0])
    return n * independent / of_mean, of_mean


def balancing_weights(runs: Runs) -> np.ndarray:
    """Return weights (n,) of pilot runs, mean one, that give log θ the means of the propagation sample.

    Entropy balancing by exponential tilting, Hainmueller 2012. All weights are one if the dual does not converge or
    leaves an effective number of runs below half: then the two samples are too different to be balanced.
    """
    a, b = runs.coordinates(runs.theta), runs.coordinates(runs.theta_more)
    n = len(a)
    centred = (a - b.mean(axis=0)) / (a.std(axis=0) + 1e-12)
    u, s, _ = np.linalg.svd(centred - centred.mean(axis=0), full_matrices=False)
    kept = s > 1e-3 * s[0]
    # Only directions in which the pilot moves can be balanced: the constrained one cannot.
    vt = np.linalg.svd(centred - centred.mean(axis=0), full_matrices=False)[2][kept]
    x = centred @ vt.T
    dual = np.zeros(x.shape[1])
    for _ in range(50):
        w = np.exp(np.clip(x @ dual, -30, 30))
        w /= w.sum()
        gradient = x.T @ w
        if np.abs(gradient).max() < 1e-10:
            break
        hessian = (x * w[:, None]).T @ x - np.outer(gradient, gradient) + 1e-12 * np.eye(len(dual))
        dual -= np.linalg.solve(hessian, gradient)
    weights = n * w
    good = np.abs(x.T @ weights).max() / n < 1e-6 and weights.sum() ** 2 / (weights**2).sum() > n / 2
    return weights if good else np.ones(n)


def outside_support(theta: np.ndarray, support: np.ndarray, inputs: tuple[str, ...]) -> Finding | None:
    """Warn of resampled 0D inputs (m, d) that leave the box of the training inputs (n, d)."""
    low, high = support.min(axis=0), support.max(axis=0)
    margin = 1e-9 * (high - low)
    beyond = (theta < low - margin) | (theta > high + margin)
    share = beyond.any(axis=1).mean()
    if share <= OUTSIDE_SHARE:
        return None
    worst = inputs[int(beyond.mean(axis=0).argmax())]
    return Finding(
        "resampled outside training",
        f"{percent(share)} of the resampled 0D inputs lie outside the training inputs, most of them in {worst}",
        "kept: the estimate remains unbiased; ρ is unreliable there, because the 0D model is extrapolated",
    )


def without_gain(rho_held_out: float, n: int, method: str) -> Finding | None:
    """Warn of a control variate whose held-out correlation is not above zero at 1 %."""
    if n < 4:
        return None
    if rho_held_out > np.tanh(stats.norm.ppf(0.99) / np.sqrt(n - 3)):
        return None
    return Finding(
        "no gain",
        f"{method} gives no significant variance reduction: held-out correlation {rho_held_out:.2f} over {n} runs",
        "shown, not recommended: use plain Monte Carlo",
        blocks=True,
    )


def unexplained(column: str, error: float) -> Finding:
    """Warn of a 0D output whose emulator leaves a fraction of its variance unexplained."""
    return Finding(
        "poor emulator",
        f"the emulator of {column} leaves {percent(error, 1)} of its variance unexplained",
        "shown, not recommended",
        blocks=True,
    )


def dominated(residuals: np.ndarray, samples: tuple[str, ...]) -> Finding | None:
    """Warn of one run that has more than DOMINANT_SHARE of the squared residuals (n,) of a control variate."""
    squares = (residuals - np.median(residuals)) ** 2
    total = squares.sum()
    if total == 0 or squares.max() <= DOMINANT_SHARE * total:
        return None
    worst = int(squares.argmax())
    return Finding(
        "one run dominates",
        f"{samples[worst]} alone has {percent(squares[worst] / total)} of the squared residuals of the best control "
        "variate",
        "kept; check whether that 3D run converged, because the interval depends on it",
    )


def coarse_failures(runs: Runs) -> Finding | None:
    """Warn of more failed runs on the coarse 3D level than its estimate has been tested with."""
    share = 0.0 if runs.coarse is None else float(runs.coarse.outputs.isna().any(axis=1).mean())
    if share <= COARSE_FAILED:
        return None
    return Finding(
        "coarse runs failed",
        f"{percent(share)} of the coarse 3D runs failed",
        "an emulator replaces them, without bias, but the interval may be too narrow: shown, not recommended",
        blocks=True,
    )


def skewed(estimate: Estimate) -> Finding | None:
    """Warn of an estimate whose interval covers less than its level because few runs carry much of it."""
    lost = lost_coverage(estimate.skewness, float(ndtri((1 + estimate.interval.level) / 2)))
    if lost <= LOST:
        return None
    # The expansion holds for small skewness; beyond, it takes more than all of the coverage.
    part = percent(lost, 1) if lost < estimate.interval.level else "a large, unknown part"
    return Finding(
        "long tail",
        f"a few runs dominate {estimate.method} (skewness {estimate.skewness:.2g}): an unadjusted interval would "
        f"lose {part} of its coverage",
        "the interval is wider for it; it cannot include a tail that no run has reached",
    )


def constant(y: np.ndarray) -> Finding | None:
    """Warn of a quantity that is the same in all runs (n,), or in all but a few."""
    values, counts = np.unique(y, return_counts=True)
    others = len(y) - int(counts.max())
    if len(values) == len(y) or others > FEW:
        return None
    if not others:
        return Finding(
            "does not vary",
            f"all {len(y)} runs have the value {values[0]:.6g}, so its error cannot be estimated from them",
            f"the interval has no width; by the rule of three, up to {percent(3 / len(y))} of the inputs may have "
            "others",
        )
    return Finding(
        "hardly varies",
        f"all but {others} of {len(y)} runs have the value {values[counts.argmax()]:.6g}",
        f"by the rule of three, values of up to {percent(3 / len(y))} of the inputs may not have been seen",
    )


def unseen(n: int) -> Finding | None:
    """Say which part of the inputs a small pilot may have missed."""
    if 3 / n < UNSEEN:
        return None
    return Finding(
        "few runs",
        f"an effect that sets in for less than {percent(3 / n)} of the inputs may not be among {n} runs",
        "rule of three, 95 %; no interval from these runs includes it",
    )


def dependent(dependence: Dependence) -> Finding | None:
    """Say how samples depend on each other, where that was found from the inputs themselves."""
    if not dependence.reason or dependence.shared:
        return None
    return Finding(
        "dependent samples",
        dependence.reason,
        "standard errors are those of segments of dependent samples; of states of a Markov chain, drawn in any order, "
        "give columns `chain` and `draw`: without them the chain's own error is not known",
    )


def disagreement(estimates: Mapping[str, Estimate], chosen: str) -> Finding | None:
    """Compare the chosen estimate with the others from the same samples; warn beyond DISAGREE joint standard errors."""
    one, worst = estimates[chosen], (0.0, "")
    for name, other in estimates.items():
        variance = (one.contributions - other.contributions).variance
        if name != chosen and variance > 0:
            worst = max(worst, (abs(one.mean - other.mean) / variance**0.5, name))
    if worst[0] <= DISAGREE:
        return None
    return Finding(
        "estimators disagree",
        f"{chosen} ({one.mean:.6g}) and {worst[1]} ({estimates[worst[1]].mean:.6g}) differ by {worst[0]:.1f} standard "
        "errors of their difference",
        "kept; one of them is biased, or pilot and propagation inputs have different laws",
    )
