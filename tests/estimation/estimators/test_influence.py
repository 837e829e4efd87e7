"""Folds that share training runs: claims that would be too small without the covariance between them."""

from itertools import product

import numpy as np
import pytest

from coronaryuq.bench.estimation.coverage import cross_fitted, run_cell
from coronaryuq.bench.estimation.problems import Trial, from_runs
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.crossfit import CrossFit, Options, Propagated, combine
from coronaryuq.estimation.estimators.influence import Influence
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.surrogates.control_variates import METHODS, Seen


def test_the_claim_with_the_covariance_between_folds_is_exact_for_two_runs():
    """Two runs, each predicting the other by g(θ_i) = θ_i y_l, with y = θ = ±1: the estimator's variance is 3/2, and
    var(residuals) / n is 1/2 in the mean."""
    means, alone, claims = [], [], []
    for theta in product((-1.0, 1.0), repeat=2):
        x = np.array(theta)
        moved = np.array([[0, x[0] * x[1]], [x[1] * x[0], 0]])
        centres = [np.zeros((1, 2))] * 2
        between = Influence(np.arange(2), moved, centres, [np.ones(1)] * 2, np.ones(2), [np.ones(1)] * 2).between()
        fit = CrossFit(x, x * x[::-1], [Propagated(np.zeros(1))] * 2, np.arange(2))
        got = combine("", fit, 2, Options(beta=1.0, between=between))
        means.append(got.mean)
        alone.append(np.var(got.residuals, ddof=1) / 2)
        claims.append(got.std**2)
    assert np.var(means) == pytest.approx(1.5)
    assert np.mean(alone) == pytest.approx(0.5)
    assert np.mean(claims) == pytest.approx(1.5)


@pytest.mark.long
def test_a_process_on_a_small_pilot_claims_enough_with_the_covariance(menon):
    """Published FFR of the LCx from 50 runs: 86 % of the spread without the covariance, 93 % with it (400 trials)."""
    runs = read_runs(menon)
    row = next(row for row in read_rows(menon / "table1.csv") if row.name == "8")
    got = run_cell(from_runs(runs, row), 50, "crossfit-GP", 400)
    assert got["claimed_over_empirical"] == pytest.approx(1, abs=0.15)
    assert got["coverage_95"] >= 0.93 - 1e-9


def test_a_pilot_without_a_corner_of_the_inputs_claims_more():
    """An exponential seen in a half of its range: the process expects to miss more where no run is, and claims so."""
    rng = generator(4, "reach")
    fold = np.arange(30) % 5
    claims = []
    for low in (-1.0, 0.0):
        x, more = rng.uniform(low, 1, (30, 1)), rng.uniform(-1, 1, (200, 1))
        trial = Trial(
            Seen(x, x[:, 0], x),
            np.exp(2 * x[:, 0]) + 0.01 * rng.normal(size=30),
            Seen(more, more[:, 0], more),
            more_y=np.zeros(200),
        )
        got = cross_fitted(trial, fold, METHODS["GP(θ)"])
        claims.append(got.residual_variance / np.var(got.residuals, ddof=1) * 30 * 200 / 230)
    assert claims[0] < 10 < 1000 < claims[1]
