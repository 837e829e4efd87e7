"""Folds that share training runs: closed-form changes against refits, and claims that are short without them."""

from itertools import product

import numpy as np
import pytest

from coronaryuq.bench.estimation.coverage import cell, cross_fitted
from coronaryuq.bench.estimation.problems import Trial, from_runs
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.crossfit import Propagated, combine
from coronaryuq.estimation.estimators.fold_covariance import Influence
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.surrogates import gaussian_process as gp
from coronaryuq.estimation.surrogates import matern
from coronaryuq.estimation.surrogates.control_variates import METHODS, RUNS_PER_POWER, Seen, with_rival


def seen_of(x):
    return Seen(x, x[:, 0], x)


@pytest.mark.parametrize("method", ["constant", "linear 0D", "linear theta"])
def test_a_change_is_the_difference_to_a_fit_without_the_run(method):
    rng = generator(4, "influence")
    x, new = rng.normal(size=(25, 4)), rng.normal(size=(7, 4))
    y = np.sin(x).sum(axis=1)
    fitted = METHODS[method](seen_of(x), y)
    for left in (0, 11):
        others = np.delete(np.arange(25), left)
        without = METHODS[method](seen_of(x[others]), y[others]).predict(seen_of(new))
        change = fitted.predict(seen_of(new)) - without
        np.testing.assert_allclose(fitted.influence(seen_of(new))[:, left], change, atol=1e-10)


def test_a_change_of_a_process_is_that_of_the_linear_smoother_it_is():
    """With weights W(x) of the outputs, leaving run l out takes W(x)_l times its leave-one-out residual away."""
    rng = generator(4, "influence", "process")
    x, new = rng.normal(size=(25, 2)), rng.normal(size=(7, 2))
    y = np.sin(2 * x[:, 0]) + x[:, 1] ** 2
    model = gp.fit(x, y)
    a = (x - model.shift) / model.scale
    k = matern.covariance(model.parameters, a, gp.JITTER)[0]
    others = np.delete(np.arange(25), 3)
    b = (y - model.mean) / model.spread
    alpha = np.linalg.solve(k[np.ix_(others, others)], b[others])
    without = model.mean + model.spread * gp._times_weights(
        model.parameters, (new - model.shift) / model.scale, a[others], alpha
    )
    np.testing.assert_allclose(model.influence(new)[:, 3], model.predict(new) - without, atol=1e-6)


def test_a_change_of_a_process_of_a_logarithm_is_that_of_its_exponential():
    """And so are its leave-one-out residuals: prediction and influence at a training run come to the same."""
    rng = generator(4, "influence", "logarithm")
    x, new = rng.normal(size=(25, 2)), rng.normal(size=(7, 2))
    y = np.exp(0.3 * x[:, 0] + 0.1 * x[:, 1] ** 2)
    model, fitted = gp.fit(np.column_stack([x, x]), np.log(y)), METHODS["process of logarithm"](seen_of(x), y)
    both = np.column_stack([new, new])
    np.testing.assert_allclose(fitted.predict(seen_of(new)), np.exp(model.predict(both)), rtol=1e-12)
    without = np.exp(model.predict(both)[:, None] - model.influence(both))
    change = fitted.predict(seen_of(new))[:, None] - without
    np.testing.assert_allclose(fitted.influence(seen_of(new)), change, atol=1e-12)
    np.testing.assert_allclose(np.log(y - fitted.leave_one_out), np.log(y) - model.leave_one_out, atol=1e-12)


def test_a_rival_that_says_something_else_widens_the_doubt_by_what_a_mixture_would_have():
    rng = generator(4, "rival")
    x, far = seen_of(rng.uniform(0, 1, (20, 1))), seen_of(np.full((3, 1), 3.0))
    y = 1 + x.row_output
    line, curve = (METHODS[name](x, y + 0.01 * np.cos(9 * y)) for name in ("linear 0D", "process of logarithm"))
    weights = np.array([line.missed, curve.missed]) ** (-20 / RUNS_PER_POWER)
    weights /= weights.sum()
    apart = line.predict(far) - curve.predict(far)
    for most in (2 * np.abs(apart).max(), 0.5 * np.abs(apart).min()):
        wanted = line.variance(far) + weights.prod() * np.minimum(np.abs(apart), most) ** 2
        np.testing.assert_allclose(with_rival(line, curve, most).variance(far), wanted)
    np.testing.assert_array_equal(with_rival(line, curve, 1.0).predict(far), line.predict(far))


def test_claim_with_the_covariance_between_folds_is_exact_where_everything_can_be_enumerated():
    """Two runs, each predicting the other by g(θ_i) = θ_i y_l, with y = θ = ±1: the estimator's variance is 3/2, and
    var(residuals) / n is 1/2 in the mean."""
    means, alone, claims = [], [], []
    for theta in product((-1.0, 1.0), repeat=2):
        x = np.array(theta)
        moved = np.array([[0, x[0] * x[1]], [x[1] * x[0], 0]])
        centres = [np.zeros((1, 2))] * 2
        between = Influence(np.arange(2), moved, centres, [np.ones(1)] * 2, np.ones(2), [np.ones(1)] * 2).between()
        got = combine("", x, x * x[::-1], [Propagated(np.zeros(1))] * 2, np.arange(2), 2, beta=1.0, between=between)
        means.append(got.mean)
        alone.append(np.var(got.residuals, ddof=1) / 2)
        claims.append(got.std**2)
    assert np.var(means) == pytest.approx(1.5)
    assert np.mean(alone) == pytest.approx(0.5)
    assert np.mean(claims) == pytest.approx(1.5)


@pytest.mark.long
def test_a_process_on_a_small_pilot_claims_too_little_without_it(menon):
    """Published FFR of the LCx from 50 runs: 86 % of the spread without the covariance, 93 % with it (400 trials)."""
    runs = read_runs(menon)
    row = next(row for row in read_rows(menon / "table1.csv") if row.name == "8")
    got = cell(from_runs(runs, row), 50, "best", 400)
    assert got["claimed_over_empirical"] == pytest.approx(1, abs=0.15)
    assert got["coverage_95"] >= 0.93 - 1e-9


def test_long_tails_widen_the_interval_and_well_known_propagation_narrows_it():
    rng = generator(4, "tails")
    flat = rng.uniform(-1, 1, 40)
    tailed = flat.copy()
    tailed[0] = 12.0
    fold = np.arange(40) % 5
    empty = [Propagated(np.zeros(1)) for _ in range(5)]

    def factor(y, blocks, held):
        got = combine("", y, held, blocks, fold, 40, beta=1.0)
        return got.interval.half_width / got.std

    none = np.zeros(40)
    assert factor(flat, empty, none) == pytest.approx(2.0227, abs=1e-4)
    assert factor(tailed, empty, none) > 2.5
    wide = [Propagated(rng.normal(0, 100, 20)) for _ in range(5)]
    assert factor(tailed, wide, none) == pytest.approx(1.96, abs=0.01)


def test_a_pilot_without_a_corner_of_the_inputs_claims_more():
    """An exponential seen in a half of its range: the process expects to miss more where no run is, and claims so."""
    rng = generator(4, "reach")
    fold = np.arange(30) % 5
    claims = []
    for low in (-1.0, 0.0):
        x, more = rng.uniform(low, 1, (30, 1)), rng.uniform(-1, 1, (200, 1))
        trial = Trial(seen_of(x), np.exp(2 * x[:, 0]) + 0.01 * rng.normal(size=30), seen_of(more), more_y=np.zeros(200))
        got = cross_fitted(trial, fold, METHODS["process theta"])
        claims.append(got.residual_variance / np.var(got.residuals, ddof=1) * 30 * 200 / 230)
    assert claims[0] < 10 < 1000 < claims[1]
