"""Coverage of probability, quantiles, variance and Sobol indices of the analytic pairs."""

import numpy as np

from coronaryuq.bench.estimation.pairs import PAIRS, Pair
from coronaryuq.bench.estimation.problems import ROW, SEED, as_design, from_pair
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import sensitivity, tails
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.estimators.per_row import predict
from coronaryuq.estimation.results import Value

SHARES, THRESHOLD_SHARE = (0.05, 0.5, 0.95), 0.2
REFERENCE, BINS = 2_000_000, 500
# An index below this is zero: the error of the reference.
NOISE = 1e-4


def truths(pair: Pair) -> dict[str, float]:
    """Return reference values from `REFERENCE` samples; their error is 1 % of the width of a trial's interval."""
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
    """Return quantity → errors, standard errors and whether the interval covered, each (trials,), of one analytic pair.

    first: number of the first trial.
    """
    pair = PAIRS[name]
    truth = truths(pair)
    threshold = float(np.quantile(pair.high(pair.draw(generator(SEED, "threshold", name), REFERENCE)), THRESHOLD_SHARE))
    every = [_trial(pair, n, number, folds, threshold) for number in range(first, first + trials)]
    found = {}
    for quantity, t in truth.items():
        values = [trial[quantity] for trial in every]
        errors, stds = np.array([value.value - t for value in values]), np.array([value.std for value in values])
        found[quantity] = errors, stds, np.array([value.holds(t) for value in values])
    return found


def _trial(pair: Pair, n: int, number: int, folds: int, threshold: float) -> dict[str, Value]:
    drawn = from_pair(pair).draw(n, number)
    design = as_design(drawn, assign(n, count(n, folds), SEED, "coverage", number))
    y, predictions = drawn.y, predict(design, ROW)
    values = {"variance": tails.variance(design, y, predictions)}
    values |= {f"quantile {share}": tails.quantile(design, y, predictions, share) for share in SHARES}
    values["probability"] = tails.probability(design, y, predictions, threshold)
    indices = sensitivity.sobol(design, y, predictions)
    return values | {f"sobol {name}": index for name, index in indices.items()}
