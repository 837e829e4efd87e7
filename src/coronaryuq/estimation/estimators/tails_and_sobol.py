"""Beyond the mean: probabilities, quantiles, variance and first-order Sobol indices, each with an interval.

Every one is a cross-fitted mean of a function of the quantity, with the same function of its prediction as control
variate, so the argument of `crossfit` holds for it as it stands.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from scipy.special import ndtr, ndtri

from coronaryuq.estimation.estimators.crossfit import Propagated, combine
from coronaryuq.estimation.estimators.fold_covariance import Between
from coronaryuq.estimation.estimators.folds_and_blocks import NODES, WEIGHTS, Design
from coronaryuq.estimation.estimators.montecarlo import Interval
from coronaryuq.estimation.estimators.per_row import Predictions
from coronaryuq.estimation.runs.table import Row, pair
from coronaryuq.estimation.settings import Settings

# Runs beyond a quantile below which its interval is not verified: with 2.5 of them it has been tried on few pairs only.
TAIL_RUNS = 10
# Expected runs on another side of a threshold than predicted from which they correct the predictions: there
# sqrt(D) / n, what the correction costs, is as large as the bound of what it mends, some D / (0.56 n).
DISAGREEMENTS, PRIOR = 1 / 3, 5
# Propagation samples per fold at which the doubt is asked for, and the share of them that counts as near a threshold.
SAMPLES, NEAR = 200, 0.05
# A distribution function is inverted at so many places, in rounds around what the one before found, until the interval
# is so many times as wide as the distance of two places.
ROUNDS, PLACES, FINE = 8, 31, 10
# Of the polynomial that stands for the effect of one input.
DEGREE = 7


def everything(design: Design, row: Row, made: Predictions, settings: Settings) -> dict:
    """Values of `beyond_the_mean` in `estimates.json`: each {value, std, low, high, level}, a `warning` where the
    interval is not verified."""
    y, _ = pair(design.runs, row)
    level = settings.level
    found = {"variance": _plain(variance(design, y, made, level))}
    found["quantiles"] = {
        f"{share:.2f}": _plain(quantile(design, y, made, share, level)) | _rare(len(y), share)
        for share in (0.05, 0.25, 0.5, 0.75, 0.95)
    }
    if row.column_3d.lower().startswith("ffr"):
        at = settings.ffr_threshold
        found["probability_at_or_below"] = {"threshold": at} | _plain(probability(design, y, made, at, level))
    found["sobol_first_order"] = sobol(design, y, made, level)
    return found


def probability(design: Design, y: np.ndarray, made: Predictions, threshold: float, level: float = 0.95):
    """P(Y ≤ threshold): (value, std, interval)."""
    found = _probability(design, y, made, _doubts(design, made), threshold, level)
    value = float(np.clip(found.value, 0, 1))
    return value, found.std, Interval(max(0.0, value - found.half), min(1.0, value + found.half), level)


def quantile(design: Design, y: np.ndarray, made: Predictions, share: float, level: float = 0.95):
    """Quantile: (value, std, interval), by inverting the estimated distribution function (Woodruff's interval)."""
    rough = np.quantile(np.concatenate([y, *made.raw]), [max(share - 0.15, 0), min(share + 0.15, 1)])
    # Room for what no run and no prediction has reached.
    room = 0.25 * (rough[1] - rough[0])
    start, end = rough[0] - room, rough[1] + room
    doubts = _doubts(design, made)
    for _ in range(ROUNDS):
        grid = np.linspace(start, end, PLACES)
        found = [_probability(design, y, made, doubts, at, level) for at in grid]
        middle, half = np.array([f.value for f in found]), np.array([f.half for f in found])
        # Every place whose interval holds the share, so the interval is as good as that of a probability; the value in
        # the middle of the first and last crossing, for the estimated function need not rise everywhere.
        low, high = _first(grid, middle + half, share), _last(grid, middle - half, share)
        value = (_first(grid, middle, share) + _last(grid, middle, share)) / 2
        # The estimated function may have steps, and the interval be narrower than the distance of two places.
        cell = grid[1] - grid[0]
        if high - low > FINE * cell:
            break
        start, end = min(low, value) - 2 * cell, max(high, value) + 2 * cell
    z = ndtri((1 + level) / 2)
    return value, (high - low) / (2 * z), Interval(min(low, value), max(high, value), level)


def variance(design: Design, y: np.ndarray, made: Predictions, level: float = 0.95):
    """Variance of Y: (value, std, interval); the interval is symmetric for its logarithm."""
    centre = combine(
        "", y, made.held, _blocks(design, made, lambda v: v), design.fold, len(y), target=design.target
    ).mean
    between = _between(made, 2 * (made.held - centre), [2 * (v - centre) for v in made.raw])
    squares = combine(
        "", (y - centre) ** 2, (made.held - centre) ** 2, _blocks(design, made, lambda v: (v - centre) ** 2),
        design.fold, len(y), level, between=between, target=design.target,
    )  # fmt: skip
    value = max(squares.mean, 1e-3 * float(np.var(y)))
    factor = float(np.exp(squares.interval.half_width / value))
    return value, squares.std, Interval(value / factor, value * factor, level)


def sobol(design: Design, y: np.ndarray, made: Predictions, level: float = 0.95) -> dict:
    """First-order index var(E[Y | θ_j]) / var Y of every input that moves: {value, std, low, high, level}.

    With h(θ_j) an estimate of E[Y | θ_j] − E[Y], var(E[Y | θ_j]) = E[2 (Y − E[Y]) h − h²] but for the square of what h
    misses; the expectation is a cross-fitted mean. h is a polynomial of log θ_j through the predictions, or their mean
    at the nodes of an input that is integrated. The interval is that of the ratio's linearisation. Inputs depend on
    each other where the total resistance is preserved: an index then counts what an input shares with others.
    """
    theta = design.runs.theta_more[np.concatenate([b.index for b in design.blocks])]
    centre = combine(
        "", y, made.held, _blocks(design, made, lambda v: v), design.fold, len(y), target=design.target
    ).mean
    found = {}
    for j, name in enumerate(design.runs.inputs):
        if np.ptp(theta[:, j]) == 0:
            continue
        effect = _at_nodes(design, made, j) if _is_integrated(design, j) else _along(design, made, j)
        found[name] = _plain(_index(design, y, made, effect, centre, level))
    return found


@dataclass(frozen=True)
class _Effect:
    """h at the pilot runs (n,), per fold at the places of `Predictions.raw`, and the sampling variance of h."""

    held: np.ndarray
    raw: list[np.ndarray]
    noise: float


def _along(design: Design, made: Predictions, j: int) -> _Effect:
    average = np.concatenate([b.average(v) for b, v in zip(design.blocks, made.raw, strict=True)])
    x = np.log(design.runs.theta_more[:, j])
    at = x[np.concatenate([b.index for b in design.blocks])]
    degree = min(DEGREE, len(np.unique(at)) - 1)
    fitted = legendre.Legendre.fit(at, average - average.mean(), degree)
    noise = np.mean((average - average.mean() - fitted(at)) ** 2) * degree / len(average)
    raw = [np.repeat(fitted(x[b.index]), b.repeats) for b in design.blocks]
    return _Effect(fitted(np.clip(design.log_theta[:, j], *fitted.domain)), raw, noise)


def _at_nodes(design: Design, made: Predictions, j: int) -> _Effect:
    at = np.concatenate([v.reshape(-1, len(NODES)) for v in made.raw]).mean(axis=0)
    h = legendre.Legendre.fit(NODES, at - at @ WEIGHTS / 2, len(NODES) - 1, domain=(-1, 1))
    low, high = design.runs.limits[j]
    held = h(np.clip(2 * (design.runs.theta[:, j] - low) / (high - low) - 1, -1, 1))
    return _Effect(held, [np.tile(h(NODES), len(b.index)) for b in design.blocks], 0.0)


def _index(design: Design, y, made: Predictions, effect: _Effect, centre: float, level: float):
    def mean(of, slope):
        blocks = [
            Propagated(b.average(of(v, h)), b.repeats)
            for b, v, h in zip(design.blocks, made.raw, effect.raw, strict=True)
        ]
        between = _between(
            made, slope(made.held, effect.held), [slope(v, h) for v, h in zip(made.raw, effect.raw, strict=True)]
        )
        # One beta for numerator and denominator: where they share a beta, they share most of their error.
        return combine(
            "", of(y, effect.held), of(made.held, effect.held), blocks, design.fold, len(y), level, beta=1.0,
            between=between,
        )  # fmt: skip

    total = mean(lambda v, h: (v - centre) ** 2, lambda v, h: 2 * (v - centre)).mean
    explained = mean(lambda v, h: 2 * (v - centre) * h - h**2, lambda v, h: 2 * h).mean - effect.noise
    if total <= 0:
        return 0.0, 1.0, Interval(0.0, 1.0, level)
    index = float(np.clip(explained / total, 0, 1))
    ratio = mean(
        lambda v, h: (2 * (v - centre) * h - h**2 - index * (v - centre) ** 2) / total,
        lambda v, h: 2 * (h - index * (v - centre)) / total,
    )
    half = ratio.interval.half_width
    return index, ratio.std, Interval(max(0.0, index - half), min(1.0, index + half), level)


def _is_integrated(design: Design, j: int) -> bool:
    if design.blocks[0].repeats == 1:
        return False
    first = design.blocks[0].log_theta[: design.blocks[0].repeats]
    return bool(np.ptp(first[:, j]) > 0)


@dataclass(frozen=True)
class _Doubt:
    """Predictions of one fold at some propagation samples, in rising order, and the variance of y given them."""

    at: np.ndarray
    variance: np.ndarray

    def near(self, threshold: float) -> float:
        """Standard deviation of y given a prediction near the threshold."""
        width = max(8, int(NEAR * len(self.at)))
        start = np.searchsorted(self.at, threshold) - width // 2
        start = int(np.clip(start, 0, max(0, len(self.at) - width)))
        return float(np.mean(self.variance[start : start + width]) ** 0.5)


def _doubts(design: Design, made: Predictions) -> list[_Doubt]:
    found = []
    for values, doubt in zip(made.raw, made.doubt, strict=True):
        variance = doubt(SAMPLES)
        order = np.argsort(values[: len(variance)], kind="stable")
        found.append(_Doubt(values[order], variance[order]))
    return found


@dataclass(frozen=True)
class _Share:
    value: float
    std: float
    half: float


def _probability(
    design: Design, y, made: Predictions, doubts: list[_Doubt], threshold: float, level: float
) -> _Share:  # fmt: skip
    """P(Y ≤ threshold) by one of two rules.

    The control variate is the normal probability of the prediction, with the width that the process itself gives near
    the threshold. Its mean square doubt h (1 − h), times n, is how many runs are expected on another side than
    predicted. From DISAGREEMENTS on they correct the estimate, as everywhere. Below, the correction is zero in most
    pilots and far too large in the rest, and no symmetric interval covers that: the predictions stand alone, and their
    error is bounded as if they were all wrong the same way, each by a standard deviation: E φ(z).
    """
    per_fold = np.maximum([d.near(threshold) for d in doubts], 1e-9 * (np.std(y) + 1e-300))
    wide = per_fold[design.fold]
    away = [(threshold - v) / w for v, w in zip(made.raw, per_fold, strict=True)]
    blocks = [Propagated(b.average(ndtr(z)), b.repeats) for b, z in zip(design.blocks, away, strict=True)]
    runs = np.bincount(design.fold, minlength=len(blocks))
    unsure = np.average(
        [np.mean(b.average(ndtr(z) * ndtr(-z))) for b, z in zip(design.blocks, away, strict=True)], weights=runs
    )
    if len(y) * unsure < DISAGREEMENTS:
        value = float(np.average([b.mean for b in blocks], weights=runs))
        same_way = np.average(
            [np.mean(b.average(np.exp(-(z**2) / 2))) for b, z in zip(design.blocks, away, strict=True)], weights=runs
        ) / np.sqrt(2 * np.pi)
        propagation = 0.0 if design.target else sum((runs / len(y)) ** 2 * [b.variance for b in blocks])
        std = float((propagation + same_way**2) ** 0.5)
        return _Share(value, std, float(ndtri((1 + level) / 2)) * std)
    steep = [_slope(z[: len(counted)], w) for z, w, counted in zip(away, per_fold, made.influence.weights, strict=True)]
    held = (threshold - made.held) / wide
    between = replace(_between(made, _slope(held, wide), steep), reach=1.0)
    # Few disagreements say less of their variance than the predictions' own doubt does, which counts as PRIOR of them.
    found = combine(
        "", (y <= threshold).astype(float), ndtr(held), blocks, design.fold, len(y), level, between=between,
        expected=float(unsure) / len(y), trust=float(PRIOR / (PRIOR + len(y) * unsure)), target=design.target,
    )  # fmt: skip
    return _Share(found.mean, found.std, found.interval.half_width)


def _slope(away, wide):
    """Derivative of the normal probability of a prediction `away` of its own `wide` below the threshold."""
    return -np.exp(-(away**2) / 2) / (np.sqrt(2 * np.pi) * wide)


def _between(made: Predictions, slope: np.ndarray, slopes: list[np.ndarray]) -> Between:
    return made.influence.between(slope, [s[: len(w)] for s, w in zip(slopes, made.influence.weights, strict=True)])


def _blocks(design: Design, made: Predictions, of) -> list[Propagated]:
    return [Propagated(b.average(of(v)), b.repeats) for b, v in zip(design.blocks, made.raw, strict=True)]


def _first(grid: np.ndarray, curve: np.ndarray, at: float) -> float:
    """Where a curve that need not rise everywhere first reaches `at`; the end of the grid where it does not."""
    reached = np.flatnonzero(curve >= at)
    if len(reached) == 0:
        return float(grid[-1])
    i = reached[0]
    if i == 0:
        return float(grid[0])
    return float(grid[i - 1] + (grid[i] - grid[i - 1]) * (at - curve[i - 1]) / (curve[i] - curve[i - 1]))


def _last(grid: np.ndarray, curve: np.ndarray, at: float) -> float:
    """Where it is for the last time no more than `at`."""
    return -_first(-grid[::-1], -curve[::-1], -at)


def _rare(n: int, share: float) -> dict:
    beyond = n * min(share, 1 - share)
    if beyond >= TAIL_RUNS - 1e-9:
        return {}
    return {"warning": f"some {beyond:.3g} of {n} runs lie beyond it: its interval is not verified below {TAIL_RUNS}"}


def _plain(found) -> dict:
    value, std, interval = found
    return {"value": value, "std": std, "low": interval.low, "high": interval.high, "level": interval.level}
