"""Probabilities, quantiles and variance, each with an interval.

Each is a cross-fitted mean of a function of the quantity, with the same function of its prediction as control variate,
so the argument of `crossfit` holds for it unchanged.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import chi2

from coronaryuq.estimation.estimators.crossfit import CrossFit, Options, combine, propagation_variance
from coronaryuq.estimation.estimators.design import Design
from coronaryuq.estimation.estimators.per_row import Predictions
from coronaryuq.estimation.results import Probability, Value

# Runs beyond a quantile below which the coverage of its interval is not tested: with 2.5 of them it has been tried on
# few pairs only.
TAIL_RUNS = 10
# Expected runs on another side of a threshold than predicted from which they correct the predictions: there
# sqrt(D) / n, what the correction costs, is as large as the bound of what it corrects, some D / (0.56 n).
DISAGREEMENTS, PRIOR = 1 / 3, 5
# Runs expected in a zone among those that lie there, from which they confirm the predictions: half a run.
CONFIRMED = 0.5
# Propagation samples per fold at which the predictive variance is computed, and the fraction of them near a threshold.
SAMPLES, NEAR = 200, 0.05
# A distribution function is inverted at so many places, in rounds around the result of the round before, until the
# interval is so many times as wide as the distance between two places.
ROUNDS, PLACES, FINE = 8, 31, 10


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
    found = _probability(design, y, predictions, _sorted_variances(predictions), (-np.inf, threshold), level)
    return _bounded(float(np.clip(found.value, 0, 1)), found, level)


def zones(
    design: Design, y: np.ndarray, predictions: Predictions, limits: Sequence[float], level: float = 0.95
) -> list[Probability]:
    """Return the probability of each zone between rising limits, from that below the first; they add up to one.

    limits: in the unit of y; the others as in `probability`.
    """
    variances = _sorted_variances(predictions)

    def share(above: float, at_most: float) -> _Share:
        return _probability(design, y, predictions, variances, (above, at_most), level)

    below = [share(-np.inf, limit) for limit in limits]
    reached = np.maximum.accumulate([np.clip(part.value, 0, 1) for part in below]).tolist()
    up_to = [_bounded(value, part, level) for value, part in zip(reached, below, strict=True)]
    found = []
    for k, (above, at_most) in enumerate(pairwise((-np.inf, *limits, np.inf))):
        probability = _bounded(np.diff([0.0, *reached, 1.0])[k].item(), share(above, at_most), level)
        # A zone is no more probable than all up to a limit beyond it, or from one before it on.
        most = min([1.0, *(part.high for part in up_to[k:]), *(1 - part.low for part in up_to[:k])])
        probability = replace(probability, high=max(probability.value, min(probability.high, most)))
        found.append(Probability(**asdict(probability), above=_finite(above), at_most=_finite(at_most)))
    return found


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
        found = [_probability(design, y, predictions, variances, (-np.inf, at), level) for at in grid]
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
    return Value(value, (high - low) / (2 * _normal(level)), min(low, value), max(high, value), level)


def variance(design: Design, y: np.ndarray, predictions: Predictions, level: float = 0.95) -> Value:
    """Return the variance of the quantity; the interval is symmetric for its logarithm. As `probability`."""
    centre = predictions.centre(design, y)
    between = predictions.between(2 * (predictions.held - centre), [2 * (v - centre) for v in predictions.raw])
    blocks = design.propagate([(v - centre) ** 2 for v in predictions.raw])
    fit = CrossFit((y - centre) ** 2, (predictions.held - centre) ** 2, blocks, design.fold, design.dependence)
    squares = combine("", fit, len(y), Options(level, between=between, target=design.target))
    value = max(squares.mean, 1e-3 * float(np.var(y)))
    # Beyond thirteen decades an interval says no more, and its ends would overflow.
    factor = float(np.exp(min(squares.interval.half_width / value, 30.0)))
    return Value(value, squares.std, value / factor, value * factor, level)


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
class _Limit:
    """A threshold, and the standard deviation (k,) of y given a prediction near it, per fold."""

    at: float
    width: np.ndarray

    def reached(self, values: np.ndarray, fold: int | np.ndarray) -> np.ndarray:
        """Return the normal probability that y is at or below the threshold, given its predictions."""
        if np.isinf(self.at):
            return np.full(len(values), float(self.at > 0))
        return ndtr(self._away(values, fold))

    def density(self, values: np.ndarray, fold: int | np.ndarray) -> np.ndarray:
        """Return the standard normal density at the distance of the threshold, in standard deviations."""
        if np.isinf(self.at):
            return np.zeros(len(values))
        return np.exp(-(self._away(values, fold) ** 2) / 2) / np.sqrt(2 * np.pi)

    def slope(self, values: np.ndarray, fold: int | np.ndarray) -> np.ndarray:
        """Differentiate `reached` by the predictions."""
        return -self.density(values, fold) / self.width[fold]

    def _away(self, values: np.ndarray, fold: int | np.ndarray) -> np.ndarray:
        return (self.at - values) / self.width[fold]


@dataclass(frozen=True)
class _Share:
    """A probability, its standard error and half of its interval's width.

    unseen: what the interval reaches to at least, see `_unseen`; 0 and 1 where the runs confirm the predictions.
    """

    value: float
    std: float
    half: float
    unseen: tuple[float, float]


def _bounded(value: float, found: _Share, level: float) -> Value:
    """Return a probability with its interval, from 0 to 1 at most, and at least to what the runs may have missed."""
    low, high, std = value - found.half, value + found.half, found.std
    if low > found.unseen[1] or high < found.unseen[0]:
        low, high = max(0.0, min(low, found.unseen[1])), min(1.0, max(high, found.unseen[0]))
        std = max(std, (high - low) / (2 * _normal(level)))
    return Value(value, std, max(0.0, low), min(1.0, high), level)


def _unseen(design: Design, inside: np.ndarray, held: np.ndarray, level: float) -> tuple[float, float]:
    """Return the least upper and the largest lower end of a zone's interval.

    Where the runs that lie in the zone were not expected there, CONFIRMED of one together at least, only predictions
    that no run confirms tell how far its probability is from zero. Then the interval reaches to the upper Poisson limit
    of the runs that do lie there; of none, that is the rule of three, −log(1 − level) / n. Likewise for one, with the
    runs outside.

    Parameters
    ----------
    design
        Dependence of the runs.
    inside
        Whether each run (n,) lies in the zone.
    held
        Its predicted probability (n,) to lie there.
    level
        Of the interval.
    """
    runs = design.dependence.effective(len(inside)) / len(inside)

    def most(found: np.ndarray, predicted: np.ndarray) -> float:
        if predicted[found].sum() >= CONFIRMED:
            return 0.0
        return min(1.0, float(chi2.ppf(level, 2 * (runs * found.sum() + 1)) / 2) / (runs * len(found)))

    return most(inside, held), 1 - most(~inside, 1 - held)


def _probability(
    design: Design, y: np.ndarray, predictions: Predictions, variances: list[_SortedVariance],
    zone: tuple[float, float], level: float,
) -> _Share:  # fmt: skip
    """P(above < Y ≤ at most) by one of two rules.

    The control variate h is the normal probability of the prediction, with the width that the process itself gives near
    each limit. Its mean square error h (1 − h), times n, is how many runs are expected on another side of a limit than
    predicted. From DISAGREEMENTS on they correct the estimate, as everywhere. Below, the correction is zero in most
    pilots and far too large in the rest, and no symmetric interval covers that: the predictions stand alone, and their
    error is bounded as if they were all wrong the same way, each by a standard deviation: E φ(z).
    """
    least = 1e-9 * (np.std(y) + 1e-300)
    above, at_most = (_Limit(at, np.maximum([v.near(at) for v in variances], least)) for at in zone)

    def inside(values: np.ndarray, fold: int | np.ndarray) -> np.ndarray:
        return np.maximum(0.0, at_most.reached(values, fold) - above.reached(values, fold))

    def slope(values: np.ndarray, fold: int | np.ndarray) -> np.ndarray:
        return at_most.slope(values, fold) - above.slope(values, fold)

    shares = [inside(v, k) for k, v in enumerate(predictions.raw)]
    blocks = design.propagate(shares)
    runs = np.bincount(design.fold, minlength=len(blocks))

    def over_folds(values: list[np.ndarray]) -> float:
        means = [np.mean(b.average(v)) for b, v in zip(design.blocks, values, strict=True)]
        return float(np.average(means, weights=runs))

    unsure = over_folds([h * (1 - h) for h in shares])
    lies, held = (zone[0] < y) & (y <= zone[1]), inside(predictions.held, design.fold)
    unseen = _unseen(design, lies, held, level)
    if len(y) * unsure < DISAGREEMENTS:
        same_way = [
            over_folds([limit.density(v, k) for k, v in enumerate(predictions.raw)]) for limit in (above, at_most)
        ]
        propagation = 0.0 if design.target else propagation_variance(blocks, runs / len(y))
        std = float((propagation + np.sum(np.square(same_way))) ** 0.5)
        value = float(np.average([b.mean for b in blocks], weights=runs))
        return _Share(value, std, _normal(level) * std, unseen)
    steep = [slope(v, k) for k, v in enumerate(predictions.raw)]
    between = replace(predictions.between(slope(predictions.held, design.fold), steep), extrapolation_factor=1.0)
    # The variance of few disagreements is less certain than the predictions' own, which counts as PRIOR of them.
    options = Options(
        level, between=between, expected=unsure / len(y), trust=float(PRIOR / (PRIOR + len(y) * unsure)),
        target=design.target,
    )  # fmt: skip
    found = combine("", CrossFit(lies.astype(float), held, blocks, design.fold, design.dependence), len(y), options)
    return _Share(found.mean, found.std, found.interval.half_width, unseen)


def _finite(limit: float) -> float | None:
    return limit if np.isfinite(limit) else None


def _normal(level: float) -> float:
    return float(ndtri((1 + level) / 2))


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


def rare(n: int, share: float) -> str | None:
    """Return why the coverage of a quantile's interval is not tested for n runs; None where it is."""
    beyond = n * min(share, 1 - share)
    if beyond >= TAIL_RUNS - 1e-9:
        return None
    number = f"about {beyond:.0f}" if beyond >= 1 else "less than one"
    return f"rests on {number} of {n} runs; its interval was tested with {TAIL_RUNS} or more"
