"""Coverage of what stands beside a mean: probability, quantiles, variance and Sobol indices of the analytic pairs."""

import numpy as np

from coronaryuq.bench.estimation.pairs import PAIRS, Pair
from coronaryuq.bench.estimation.problems import ROW, SEED, as_design, from_pair
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import tails_and_sobol
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.estimators.montecarlo import Interval
from coronaryuq.estimation.estimators.per_row import predict

SHARES, THRESHOLD_SHARE = (0.05, 0.5, 0.95), 0.2
REFERENCE, BINS = 2_000_000, 500
# What the reference leaves of an index that is zero.
NOISE = 1e-4


def truths(pair: Pair) -> dict[str, float]:
    """Reference values by `REFERENCE` samples; their error is a hundredth of what an interval of a trial is wide."""
    theta = pair.draw(generator(SEED, "coverage", "reference", pair.name), REFERENCE)
    y = pair.high(theta)
    found = {"variance": float(y.var())}
    found |= {f"quantile {share}": float(np.quantile(y, share)) for share in SHARES}
    found["probability"] = THRESHOLD_SHARE
    for j in range(theta.shape[1]):
        order = np.argsort(theta[:, j])
        parts = y[order].reshape(BINS, -1)
        between = parts.mean(axis=1).var() - parts.var(axis=1).mean() / parts.shape[1]
        index = float(between / y.var())
        found[f"sobol theta_{j}"] = index if index > NOISE else 0.0
    return found


def errors(
    name: str, n: int, trials: int, folds: int, first: int = 0
) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Quantity → errors, claims and whether the interval held, each (trials,), of one analytic pair.

    first: number of the first trial.
    """
    pair = PAIRS[name]
    truth = truths(pair)
    threshold = float(np.quantile(pair.high(pair.draw(generator(SEED, "threshold", name), REFERENCE)), THRESHOLD_SHARE))
    every = [_trial(pair, n, number, folds, threshold) for number in range(first, first + trials)]
    made = {}
    for quantity, t in truth.items():
        values = [one[quantity] for one in every]
        made[quantity] = tuple(
            np.array(v) for v in zip(*((value - t, std, held.holds(t)) for value, std, held in values), strict=True)
        )
    return made


def _trial(pair: Pair, n: int, number: int, folds: int, threshold: float) -> dict[str, tuple[float, float, Interval]]:
    drawn = from_pair(pair).draw(n, number)
    design = as_design(drawn, assign(n, count(n, folds), SEED, "coverage", number))
    y, made = drawn.y, predict(design, ROW)
    values = {"variance": tails_and_sobol.variance(design, y, made)}
    values |= {f"quantile {share}": tails_and_sobol.quantile(design, y, made, share) for share in SHARES}
    values["probability"] = tails_and_sobol.probability(design, y, made, threshold)
    for name, index in tails_and_sobol.sobol(design, y, made).items():
        values[f"sobol {name}"] = index["value"], index["std"], Interval(index["low"], index["high"], index["level"])
    return values
