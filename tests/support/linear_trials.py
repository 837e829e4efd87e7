"""Repeated trials of a linear model, and a check of the intervals that they give."""

from functools import cache

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.design import Block, Design
from coronaryuq.estimation.estimators.folds import assign
from coronaryuq.estimation.estimators.per_row import Predictions, predict
from coronaryuq.estimation.runs.table import Row
from support.runs import runs_of

TRIALS, N, M, FOLDS = 200, 60, 1500, 10
ROW = Row("1", "ffr_lad", "q", "")
VARIANCE = 1.3125


@cache
def linear_trials() -> list[tuple[Design, np.ndarray, Predictions]]:
    """Y = log θ_1 + log θ_2 / 2 + noise, a normal with variance 1 + 1/4 + 1/16; linear control variates."""
    made = []
    for trial in range(TRIALS):
        rng = generator(5, "beyond", trial)
        x, more = rng.normal(size=(N, 2)), rng.normal(size=(M, 2))
        y = x[:, 0] + 0.5 * x[:, 1] + 0.25 * rng.normal(size=N)
        runs = runs_of(np.exp(x), {"ffr_lad": y}, {"q": x[:, 0]}, np.exp(more))
        index = [np.arange(k, M, FOLDS) for k in range(FOLDS)]
        blocks = [Block(i, more[i], {"q": more[i, 0]}, 1) for i in index]
        fold = assign(N, FOLDS, 5, "beyond", trial)
        design = Design(runs, fold, blocks, {"q": x[:, 0]}, ["q"], {"q": 0.0}, False)
        made.append((design, y, predict(design, ROW, simple=True)))
    return made


def coverage(found, truth):
    return np.mean([value.holds(truth) for value in found])


def check(found, truth):
    """Coverage within three binomial standard errors of 95 %; claimed spread within 20 % (four standard errors)."""
    values = np.array([value.value for value in found])
    claimed = np.sqrt(np.mean([value.std**2 for value in found]))
    assert coverage(found, truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found))
    assert claimed / values.std() == pytest.approx(1, abs=0.2)
    assert abs(values.mean() - truth) < 4 * values.std() / np.sqrt(len(found))
