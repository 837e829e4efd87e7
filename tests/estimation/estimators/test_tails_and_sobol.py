"""Probabilities, quantiles, variance and Sobol indices against known values, over repeated trials."""

import numpy as np
import pytest
from scipy.stats import norm

from coronaryuq.bench.estimation.problems import ROW as ANY
from coronaryuq.bench.estimation.problems import Trial, as_design
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import tails_and_sobol
from coronaryuq.estimation.estimators.design import Block, Design
from coronaryuq.estimation.estimators.folds import assign
from coronaryuq.estimation.estimators.per_row import predict
from coronaryuq.estimation.runs.table import Row
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates.control_variates import Seen
from support.runs import runs_of

pytestmark = pytest.mark.slow

TRIALS, N, M, FOLDS = 200, 60, 1500, 10
ROW = Row("1", "ffr_lad", "q", "")


@pytest.fixture(scope="module")
def trials():
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
    assert coverage(found, truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / TRIALS)
    assert claimed / values.std() == pytest.approx(1, abs=0.2)
    assert abs(values.mean() - truth) < 4 * values.std() / np.sqrt(TRIALS)


@pytest.mark.parametrize("at", [0.0, -1.5])
def test_probabilities_hold_their_claims(trials, at):
    check([tails_and_sobol.probability(d, y, p, at) for d, y, p in trials], norm.cdf(at / np.sqrt(1.3125)))


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_quantiles_hold_their_claims(trials, share):
    found = [tails_and_sobol.quantile(d, y, p, share) for d, y, p in trials[:120]]
    truth = norm.ppf(share) * np.sqrt(1.3125)
    assert coverage(found, truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found))
    assert abs(np.mean([value.value for value in found]) - truth) < 0.05


@pytest.mark.parametrize("share", [0.052, 0.503, 0.951])
def test_a_quantile_of_a_finite_set_with_nearly_exact_predictions_is_that_of_the_set(share):
    """400 values are wanted, and intervals far narrower than what lies between two of them."""
    rng = generator(5, "beyond", "finite")
    x, more = rng.normal(size=(50, 2)), rng.normal(size=(400, 2))
    trial = Trial(seen_of(x), np.exp(0.1 * x[:, 0]), seen_of(more), more_y=np.exp(0.1 * more[:, 0]))
    design = as_design(trial, assign(50, 10, 5, "finite"))
    got = tails_and_sobol.quantile(design, trial.y, predict(design, ANY), share)
    assert got.holds(np.sort(trial.more_y)[int(share * 400)])
    assert got.high - got.low < 4e-4


def seen_of(x):
    return Seen(x, x[:, 0], x)


def test_the_variance_holds_its_claim(trials):
    check([tails_and_sobol.variance(d, y, p) for d, y, p in trials], 1.3125)


@pytest.mark.parametrize(("name", "truth"), [("a", 1 / 1.3125), ("b", 0.25 / 1.3125)])
def test_sobol_indices_of_an_additive_model_hold_their_claims(trials, name, truth):
    check([tails_and_sobol.sobol(d, y, p)[name] for d, y, p in trials], truth)


def test_a_quantile_with_few_runs_beyond_it_carries_a_warning(trials):
    found = tails_and_sobol.everything(trials[0][0], ROW, trials[0][2], Settings())
    warned = {share for share, value in found.quantiles.items() if value.warning}
    assert warned == {"0.05", "0.95"}
