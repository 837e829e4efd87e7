"""Beyond the mean: probabilities, quantiles, variance and first-order Sobol indices, each with an interval.

Every one is a cross-fitted mean of a function of the quantity, with the same function of its prediction as control
variate, so the argument of `crossfit` holds for it as it stands.
"""

import numpy as np
from scipy.stats import norm

from coronaryuq.estimation.crossfit import Estimate, Propagated, combine
from coronaryuq.estimation.design import WEIGHTS, Design
from coronaryuq.estimation.estimators import Predictions
from coronaryuq.estimation.influence import Between
from coronaryuq.estimation.montecarlo import Interval
from coronaryuq.estimation.runs import Row, pair
from coronaryuq.estimation.settings import Settings
from coronaryuq.seeds import generator

BOOTSTRAP, BINS = 200, 20


def everything(design: Design, row: Row, made: Predictions, settings: Settings, seed: int) -> dict:
    """Values of `beyond_the_mean` in `estimates.json`: each {value, std, low, high, level}."""
    y, _ = pair(design.runs, row)
    level = settings.level
    found = {"variance": _plain(variance(design, y, made, level))}
    found["quantiles"] = {
        f"{share:.2f}": _plain(quantile(design, y, made, share, level)) for share in (0.05, 0.25, 0.5, 0.75, 0.95)
    }
    if row.column_3d.lower().startswith("ffr"):
        at = settings.ffr_threshold
        found["probability_at_or_below"] = {"threshold": at} | _plain(probability(design, y, made, at, level))
    found["sobol_first_order"] = sobol(design, y, made, level, seed)
    return found


def probability(design: Design, y: np.ndarray, made: Predictions, threshold: float, level: float = 0.95):
    """P(Y ≤ threshold): (value, std, interval). The control variate is the normal probability of its prediction.

    Where every run agrees with its prediction the residuals say nothing of how rare a disagreement is: the interval
    is at least as wide as the rule of three allows.
    """
    estimate = _probability(design, y, made, threshold, level)
    value = float(np.clip(estimate.mean, 0, 1))
    agreed = np.max(np.abs(estimate.residuals - estimate.residuals.mean())) < 0.5
    room = 3 / len(y) if agreed else 0.0
    half = max(estimate.interval.half_width, room * min(1.0, 4 * max(value, 1 / len(y)) * max(1 - value, 1 / len(y))))
    return value, estimate.std, Interval(max(0.0, value - half), min(1.0, value + half), level)


def quantile(design: Design, y: np.ndarray, made: Predictions, share: float, level: float = 0.95):
    """Quantile: (value, std, interval), by inverting the estimated distribution function (Woodruff's interval)."""
    rough = np.quantile(np.concatenate([y, *made.raw]), [max(share - 0.15, 0), min(share + 0.15, 1)])
    grid = np.linspace(rough[0], rough[1], 61)
    found = [_probability(design, y, made, at, level) for at in grid]
    middle = np.maximum.accumulate([f.mean for f in found])
    half = np.array([f.interval.half_width for f in found])
    value = _crossing(grid, middle, share)
    low, high = _crossing(grid, middle + half, share), _crossing(grid, middle - half, share)
    z = norm.ppf((1 + level) / 2)
    return value, (high - low) / (2 * z), Interval(min(low, value), max(high, value), level)


def variance(design: Design, y: np.ndarray, made: Predictions, level: float = 0.95):
    """Variance of Y: (value, std, interval); the interval is symmetric for its logarithm."""
    centre = combine("", y, made.held, _blocks(design, made, lambda v: v), design.fold, len(y), level).mean
    between = _between(made, 2 * (made.held - centre), [2 * (v - centre) for v in made.raw])
    squares = combine(
        "", (y - centre) ** 2, (made.held - centre) ** 2, _blocks(design, made, lambda v: (v - centre) ** 2),
        design.fold, len(y), level, between=between,
    )  # fmt: skip
    value = max(squares.mean, 1e-3 * float(np.var(y)))
    factor = float(np.exp(squares.interval.half_width / value))
    return value, squares.std, Interval(value / factor, value * factor, level)


def sobol(design: Design, y: np.ndarray, made: Predictions, level: float, seed: int) -> dict:
    """First-order index var(E[Y | θ_j]) / var Y of every input, with percentile bootstrap intervals.

    h_j(θ_j) is the mean of the predictions given θ_j in BINS bins of equal content, from propagation samples; the
    index is the squared correlation of Y with h_j, its moments taken on propagation samples and corrected by the
    pilot's residuals. Inputs depend on each other where the total resistance is preserved: an index then counts what
    an input shares with others.
    """
    runs, blocks = design.runs, design.blocks
    index = np.concatenate([b.index for b in blocks])
    theta = runs.theta_more[index]
    average = np.concatenate([b.average(v) for b, v in zip(blocks, made.raw, strict=True)])
    second = np.concatenate([b.average(v**2) for b, v in zip(blocks, made.raw, strict=True)])
    residual = y - made.held
    rng, found = generator(seed, "estimation", "sobol"), {}
    draws = [(rng.integers(len(y), size=len(y)), rng.integers(len(index), size=len(index))) for _ in range(BOOTSTRAP)]
    draws.insert(0, (np.arange(len(y)), np.arange(len(index))))
    for j, name in enumerate(runs.inputs):
        if np.ptp(theta[:, j]) == 0:
            continue
        edges = np.quantile(theta[:, j], np.linspace(0, 1, BINS + 1)[1:-1])
        bins, bins_pilot = np.searchsorted(edges, theta[:, j]), np.searchsorted(edges, runs.theta[:, j])
        effect = _effect(design, made) if _is_integrated(design, j) else None
        values = np.array([
            _index(average[b], second[b], bins[b], bins_pilot[a], residual[a], made.held[a], effect) for a, b in draws
        ])  # fmt: skip
        low, high = np.quantile(values[1:], [(1 - level) / 2, (1 + level) / 2])
        # The bootstrap repeats the upward bias of binning noise: take it off once, from centre and bounds alike.
        bias = max(values[1:].mean() - values[0], 0.0)
        value, low, high = (float(np.clip(v - bias, 0, 1)) for v in (values[0], low, high))
        found[name] = {"value": value, "std": float(values[1:].std()), "low": low, "high": high, "level": level}
    return found


def _index(average, second, bins, bins_pilot, residual, held, effect) -> float:
    mean = average.mean()
    total = second.mean() - mean**2 + np.mean(residual**2 + 2 * residual * (held - mean)) - residual.mean() ** 2
    if total <= 0:
        return 0.0
    if effect is not None:
        return float(np.clip(effect / total, 0, 1))
    counts = np.maximum(np.bincount(bins, minlength=BINS), 1)
    given = np.bincount(bins, average, minlength=BINS) / counts - mean
    spread = np.average(given**2, weights=counts)
    # Bin means carry sampling noise of their own.
    within = np.average((average - mean - given[bins]) ** 2) * BINS / len(average)
    joint = spread - within + np.mean(residual * given[bins_pilot]) - residual.mean() * given[bins_pilot].mean()
    return float(np.clip(max(joint, 0.0) ** 2 / max(spread - within, 1e-300) / total, 0, 1))


def _effect(design: Design, made: Predictions) -> float:
    """Variance of the mean over all other inputs, as a function of the integrated one, at its Gauss nodes."""
    repeats = design.blocks[0].repeats
    at = np.concatenate([v.reshape(-1, repeats) for v in made.raw]).mean(axis=0)
    return float(at**2 @ WEIGHTS / 2 - (at @ WEIGHTS / 2) ** 2)


def _is_integrated(design: Design, j: int) -> bool:
    if design.blocks[0].repeats == 1:
        return False
    first = design.blocks[0].log_theta[: design.blocks[0].repeats]
    return bool(np.ptp(first[:, j]) > 0)


def _probability(design: Design, y, made: Predictions, threshold: float, level: float) -> Estimate:
    wide = np.maximum(made.noise, 1e-9 * (np.std(y) + 1e-300))
    per_fold = [wide[design.fold == k][0] if (design.fold == k).any() else wide[0] for k in range(len(design.blocks))]
    blocks = [
        Propagated(b.average(norm.cdf((threshold - v) / w)), b.repeats)
        for b, v, w in zip(design.blocks, made.raw, per_fold, strict=True)
    ]
    held = norm.cdf((threshold - made.held) / wide)
    steep = [-norm.pdf((threshold - v) / w) / w for v, w in zip(made.raw, per_fold, strict=True)]
    between = _between(made, -norm.pdf((threshold - made.held) / wide) / wide, steep)
    return combine("", (y <= threshold).astype(float), held, blocks, design.fold, len(y), level, between=between)


def _between(made: Predictions, slope: np.ndarray, slopes: list[np.ndarray]) -> Between:
    return made.influence.between(slope, [s[: len(w)] for s, w in zip(slopes, made.influence.weights, strict=True)])


def _blocks(design: Design, made: Predictions, of) -> list[Propagated]:
    return [Propagated(b.average(of(v)), b.repeats) for b, v in zip(design.blocks, made.raw, strict=True)]


def _crossing(grid: np.ndarray, rising: np.ndarray, at: float) -> float:
    return float(np.interp(at, np.maximum.accumulate(rising), grid))


def _plain(found) -> dict:
    value, std, interval = found
    return {"value": value, "std": std, "low": interval.low, "high": interval.high, "level": interval.level}
