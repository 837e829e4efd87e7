"""Probabilities, quantiles, variance and first-order Sobol indices, each with an interval.

Each is a cross-fitted mean of a function of the quantity, with the same function of its prediction as control variate,
so the argument of `crossfit` holds for it unchanged.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from scipy.special import ndtr, ndtri

from coronaryuq.estimation.estimators.crossfit import CrossFit, Estimate, Options, combine, propagation_variance
from coronaryuq.estimation.estimators.design import NODES, WEIGHTS, Design
from coronaryuq.estimation.estimators.influence import Between
from coronaryuq.estimation.estimators.per_row import Predictions
from coronaryuq.estimation.results import BeyondTheMean, Probability, Value
from coronaryuq.estimation.runs.table import Row, pair
from coronaryuq.estimation.settings import Settings

# Runs beyond a quantile below which the coverage of its interval is not tested: with 2.5 of them it has been tried on
# few pairs only.
TAIL_RUNS = 10
# Expected runs on another side of a threshold than predicted from which they correct the predictions: there
# sqrt(D) / n, what the correction costs, is as large as the bound of what it corrects, some D / (0.56 n).
DISAGREEMENTS, PRIOR = 1 / 3, 5
# Propagation samples per fold at which the predictive variance is computed, and the share of them near a threshold.
SAMPLES, NEAR = 200, 0.05
# A distribution function is inverted at so many places, in rounds around the result of the round before, until the
# interval is so many times as wide as the distance between two places.
ROUNDS, PLACES, FINE = 8, 31, 10
# Of the polynomial that represents the effect of one input.
DEGREE = 7
SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)


def everything(design: Design, row: Row, predictions: Predictions, settings: Settings) -> BeyondTheMean:
    """Everything beyond the mean of one row; a quantile whose coverage is not tested carries a warning."""
    y, _ = pair(design.runs, row)
    level = settings.level
    found = BeyondTheMean(
        variance=variance(design, y, predictions, level),
        quantiles={
            f"{share:.2f}": replace(quantile(design, y, predictions, share, level), warning=_rare(len(y), share))
            for share in SHARES
        },
        sobol_first_order=sobol(design, y, predictions, level),
    )
    if not row.column_3d.lower().startswith("ffr"):
        return found
    at = settings.ffr_threshold
    below = probability(design, y, predictions, at, level)
    return replace(
        found, probability_at_or_below=Probability(at, below.value, below.std, below.low, below.high, below.level)
    )


def probability(
    design: Design, y: np.ndarray, predictions: Predictions, threshold: float, level: float = 0.95
) -> Value:
    """Return the probability that the quantity is at or below a threshold.

    Parameters
    ----------
    design
        Folds and propagation blocks.
    y
        3D outputs (n,) of the pilot.
    predictions
        Cross-fitted predictions of y.
    threshold
        In the unit of y.
    level
        Of the interval.
    """
    found = _probability(design, y, predictions, _sorted_variances(predictions), threshold, level)
    value = float(np.clip(found.value, 0, 1))
    return Value(value, found.std, max(0.0, value - found.half), min(1.0, value + found.half), level)


def quantile(design: Design, y: np.ndarray, predictions: Predictions, share: float, level: float = 0.95) -> Value:
    """Return a quantile by inverting the estimated distribution function (Woodruff's interval).

    share: of the distribution below it; the others as in `probability`.
    """
    rough = np.quantile(np.concatenate([y, *predictions.raw]), [max(share - 0.15, 0), min(share + 0.15, 1)])
    # Room for what no run and no prediction has reached.
    room = 0.25 * (rough[1] - rough[0])
    start, end = rough[0] - room, rough[1] + room
    variances = _sorted_variances(predictions)
    for _ in range(ROUNDS):
        grid = np.linspace(start, end, PLACES)
        found = [_probability(design, y, predictions, variances, at, level) for at in grid]
        middle, half = np.array([f.value for f in found]), np.array([f.half for f in found])
        # Every place whose interval holds the share, so the interval is as good as that of a probability; the value in
        # the middle of the first and last crossing, for the estimated function need not rise everywhere.
        low, high = _first(grid, middle + half, share), _last(grid, middle - half, share)
        value = (_first(grid, middle, share) + _last(grid, middle, share)) / 2
        # The estimated function may have steps, and the interval may be narrower than the distance of two places.
        cell = grid[1] - grid[0]
        if high - low > FINE * cell:
            break
        start, end = min(low, value) - 2 * cell, max(high, value) + 2 * cell
    z = ndtri((1 + level) / 2)
    return Value(value, (high - low) / (2 * z), min(low, value), max(high, value), level)


def variance(design: Design, y: np.ndarray, predictions: Predictions, level: float = 0.95) -> Value:
    """Return the variance of the quantity; the interval is symmetric for its logarithm. As `probability`."""
    centre = _centre(design, y, predictions)
    slopes = [2 * (v - centre) for v in predictions.raw]
    between = _between(predictions, 2 * (predictions.held - centre), slopes)
    blocks = design.propagate([(v - centre) ** 2 for v in predictions.raw])
    fit = CrossFit((y - centre) ** 2, (predictions.held - centre) ** 2, blocks, design.fold, design.dependence)
    squares = combine("", fit, len(y), Options(level, between=between, target=design.target))
    value = max(squares.mean, 1e-3 * float(np.var(y)))
    factor = float(np.exp(squares.interval.half_width / value))
    return Value(value, squares.std, value / factor, value * factor, level)


def sobol(design: Design, y: np.ndarray, predictions: Predictions, level: float = 0.95) -> dict[str, Value]:
    """Return the first-order index var(E[Y | θ_j]) / var Y of every input that moves. As `probability`.

    With h(θ_j) an estimate of E[Y | θ_j] − E[Y], var(E[Y | θ_j]) = E[2 (Y − E[Y]) h − h²] but for the square of what h
    misses; the expectation is a cross-fitted mean. h is a polynomial of log θ_j through the predictions, or their mean
    at the nodes of an input that is integrated. The interval is that of the ratio's linearisation. Inputs depend on
    each other where the total resistance is preserved: an index then counts what an input shares with others.
    """
    theta = design.runs.theta_more[np.concatenate([b.index for b in design.blocks])]
    centre = _centre(design, y, predictions)
    found = {}
    for j, name in enumerate(design.runs.inputs):
        if np.ptp(theta[:, j]) == 0:
            continue
        effect = _at_nodes(design, predictions, j) if _is_integrated(design, j) else _along(design, predictions, j)
        found[name] = _index(design, y, predictions, effect, centre, level)
    return found


def _centre(design: Design, y: np.ndarray, predictions: Predictions) -> float:
    fit = CrossFit(y, predictions.held, design.propagate(predictions.raw), design.fold, design.dependence)
    return combine("", fit, len(y), Options(target=design.target)).mean


@dataclass(frozen=True)
class _Effect:
    """h at the pilot runs (n,), per fold at the places of `Predictions.raw`, and the sampling variance of h."""

    held: np.ndarray
    raw: list[np.ndarray]
    noise: float


def _along(design: Design, predictions: Predictions, j: int) -> _Effect:
    average = np.concatenate([b.average(v) for b, v in zip(design.blocks, predictions.raw, strict=True)])
    x = design.runs.coordinates(design.runs.theta_more)[:, j]
    at = x[np.concatenate([b.index for b in design.blocks])]
    degree = min(DEGREE, len(np.unique(at)) - 1)
    fitted = legendre.Legendre.fit(at, average - average.mean(), degree)
    noise = np.mean((average - average.mean() - fitted(at)) ** 2) * degree / len(average)
    raw = [np.repeat(fitted(x[b.index]), b.repeats) for b in design.blocks]
    return _Effect(fitted(np.clip(design.log_theta[:, j], *fitted.domain)), raw, noise)


def _at_nodes(design: Design, predictions: Predictions, j: int) -> _Effect:
    at = np.concatenate([v.reshape(-1, len(NODES)) for v in predictions.raw]).mean(axis=0)
    h = legendre.Legendre.fit(NODES, at - at @ WEIGHTS / 2, len(NODES) - 1, domain=(-1, 1))
    low, high = design.runs.bounds(design.runs.inputs[j])
    held = h(np.clip(2 * (design.runs.theta[:, j] - low) / (high - low) - 1, -1, 1))
    return _Effect(held, [np.tile(h(NODES), len(b.index)) for b in design.blocks], 0.0)


Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Of the quantity (or its prediction) and of h at the same samples."""


def _index(
    design: Design, y: np.ndarray, predictions: Predictions, effect: _Effect, centre: float, level: float
) -> Value:
    def mean(function: Function, slope: Function) -> Estimate:
        raw = list(zip(predictions.raw, effect.raw, strict=True))
        slopes = [slope(v, h) for v, h in raw]
        between = _between(predictions, slope(predictions.held, effect.held), slopes)
        held, blocks = function(predictions.held, effect.held), design.propagate([function(v, h) for v, h in raw])
        # One beta for numerator and denominator: where they share a beta, they share most of their error.
        fit = CrossFit(function(y, effect.held), held, blocks, design.fold, design.dependence)
        return combine("", fit, len(y), Options(level, beta=1.0, between=between))

    total = mean(lambda v, h: (v - centre) ** 2, lambda v, h: 2 * (v - centre)).mean
    explained = mean(lambda v, h: 2 * (v - centre) * h - h**2, lambda v, h: 2 * h).mean - effect.noise
    if total <= 0:
        return Value(0.0, 1.0, 0.0, 1.0, level)
    index = float(np.clip(explained / total, 0, 1))
    ratio = mean(
        lambda v, h: (2 * (v - centre) * h - h**2 - index * (v - centre) ** 2) / total,
        lambda v, h: 2 * (h - index * (v - centre)) / total,
    )
    half = ratio.interval.half_width
    return Value(index, ratio.std, max(0.0, index - half), min(1.0, index + half), level)


def _is_integrated(design: Design, j: int) -> bool:
    if design.blocks[0].repeats == 1:
        return False
    first = design.blocks[0].log_theta[: design.blocks[0].repeats]
    return bool(np.ptp(first[:, j]) > 0)


@dataclass(frozen=True)
class _SortedVariance:
    """Predictions of one fold at some propagation samples, in rising order, and the variance of y given them."""

    at: np.ndarray
    variance: np.ndarray

    def near(self, threshold: float) -> float:
        """Return the standard deviation of y given a prediction near the threshold."""
        width = max(8, int(NEAR * len(self.at)))
        first = np.searchsorted(self.at, threshold) - width // 2
        start = int(np.clip(first, 0, max(0, len(self.at) - width)))
        return float(np.mean(self.variance[start : start + width]) ** 0.5)


def _sorted_variances(predictions: Predictions) -> list[_SortedVariance]:
    found = []
    for values, variance_at in zip(predictions.raw, predictions.variance, strict=True):
        some = variance_at(SAMPLES)
        order = np.argsort(values[: len(some)], kind="stable")
        found.append(_SortedVariance(values[order], some[order]))
    return found


@dataclass(frozen=True)
class _Share:
    value: float
    std: float
    half: float


def _probability(
    design: Design, y: np.ndarray, predictions: Predictions, variances: list[_SortedVariance], threshold: float,
    level: float,
) -> _Share:  # fmt: skip
    """P(Y ≤ threshold) by one of two rules.

    The control variate is the normal probability of the prediction, with the width that the process itself gives near
    the threshold. Its mean square error h (1 − h), times n, is how many runs are expected on another side than
    predicted. From DISAGREEMENTS on they correct the estimate, as everywhere. Below, the correction is zero in most
    pilots and far too large in the rest, and no symmetric interval covers that: the predictions stand alone, and their
    error is bounded as if they were all wrong the same way, each by a standard deviation: E φ(z).
    """
    per_fold = np.maximum([v.near(threshold) for v in variances], 1e-9 * (np.std(y) + 1e-300))
    wide = per_fold[design.fold]
    away = [(threshold - v) / w for v, w in zip(predictions.raw, per_fold, strict=True)]
    blocks = design.propagate([ndtr(z) for z in away])
    runs = np.bincount(design.fold, minlength=len(blocks))
    unsure = np.average(
        [np.mean(b.average(ndtr(z) * ndtr(-z))) for b, z in zip(design.blocks, away, strict=True)], weights=runs
    )
    if len(y) * unsure < DISAGREEMENTS:
        value = float(np.average([b.mean for b in blocks], weights=runs))
        same_way = np.average(
            [np.mean(b.average(np.exp(-(z**2) / 2))) for b, z in zip(design.blocks, away, strict=True)], weights=runs
        ) / np.sqrt(2 * np.pi)
        propagation = 0.0 if design.target else propagation_variance(blocks, runs / len(y))
        std = float((propagation + same_way**2) ** 0.5)
        return _Share(value, std, float(ndtri((1 + level) / 2)) * std)
    counted = [len(weights) for weights in predictions.influence.weights]
    steep = [_slope(z[:m], w) for z, w, m in zip(away, per_fold, counted, strict=True)]
    held = (threshold - predictions.held) / wide
    between = replace(_between(predictions, _slope(held, wide), steep), extrapolation_factor=1.0)
    # The variance of few disagreements is less certain than the predictions' own, which counts as PRIOR of them.
    options = Options(
        level, between=between, expected=float(unsure) / len(y), trust=float(PRIOR / (PRIOR + len(y) * unsure)),
        target=design.target,
    )  # fmt: skip
    found = combine(
        "",
        CrossFit((y <= threshold).astype(float), ndtr(held), blocks, design.fold, design.dependence),
        len(y),
        options,
    )
    return _Share(found.mean, found.std, found.interval.half_width)


def _slope(away: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """Differentiate the normal probability of a prediction `away` standard deviations (`wide`) below the threshold."""
    return -np.exp(-(away**2) / 2) / (np.sqrt(2 * np.pi) * wide)


def _between(predictions: Predictions, slope: np.ndarray, slopes: list[np.ndarray]) -> Between:
    return predictions.influence.between(
        slope, [s[: len(w)] for s, w in zip(slopes, predictions.influence.weights, strict=True)]
    )


def _first(grid: np.ndarray, curve: np.ndarray, at: float) -> float:
    """First x at which a curve that need not rise everywhere reaches `at`; the end of the grid if it does not."""
    reached = np.flatnonzero(curve >= at)
    if len(reached) == 0:
        return float(grid[-1])
    i = reached[0]
    if i == 0:
        return float(grid[0])
    return float(grid[i - 1] + (grid[i] - grid[i - 1]) * (at - curve[i - 1]) / (curve[i] - curve[i - 1]))


def _last(grid: np.ndarray, curve: np.ndarray, at: float) -> float:
    """Last x at which the curve is no more than `at`."""
    return -_first(-grid[::-1], -curve[::-1], -at)


def _rare(n: int, share: float) -> str | None:
    beyond = n * min(share, 1 - share)
    if beyond >= TAIL_RUNS - 1e-9:
        return None
    return f"only about {beyond:.3g} of {n} runs lie beyond it; coverage is not tested below {TAIL_RUNS}"
