"""Repeated trials of a linear model, and a check of the intervals that they give."""

from functools import cache

import numpy as np
import pytest
from scipy.special import ndtri

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
        made.append(_predicted(x, y, more, ("beyond", trial)))
    return made


@cache
def onset_trials(share: float) -> list[tuple[Design, np.ndarray, Predictions]]:
    """Y = log θ_1, less 10 in a `share` of the states, of which 0D shows nothing; linear control variates."""
    made = []
    for trial in range(TRIALS):
        rng = generator(5, "onset", trial)
        x, more = rng.normal(size=(N, 2)), rng.normal(size=(M, 2))
        y = x[:, 0] - 10.0 * (x[:, 1] > ndtri(1 - share))
        made.append(_predicted(x, y, more, ("onset", trial)))
    return made


def _predicted(x: np.ndarray, y: np.ndarray, more: np.ndarray, name: tuple) -> tuple[Design, np.ndarray, Predictions]:
    """Return the design of a trial, its outputs, and their predictions; the 0D output is log θ_1."""
    runs = runs_of(np.exp(x), {"ffr_lad": y}, {"q": x[:, 0]}, np.exp(more))
    blocks = [
        Block(index, more[index], {"q": more[index, 0]}, 1) for index in (np.arange(k, M, FOLDS) for k in range(FOLDS))
    ]
    fold = assign(N, FOLDS, 5, *name)
    design = Design(runs, fold, blocks, {"q": x[:, 0]}, ["q"], {"q": 0.0}, False)
    return design, y, predict(design, ROW, simple=True)


def coverage(found, truth):
    return np.mean([value.holds(truth) for value in found])


def check(found, truth):
    """Coverage within three binomial standard errors of 95 %; claimed spread within 20 % (four standard errors)."""
    values = np.array([value.value for value in found])
    claimed = np.sqrt(np.mean([value.std**2 for value in found]))
    assert coverage(found, truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found))
    assert claimed / values.std() == pytest.approx(1, abs=0.2)
    assert abs(values.mean() - truth) < 4 * values.std() / np.sqrt(len(found))
