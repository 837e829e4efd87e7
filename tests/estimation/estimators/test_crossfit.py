"""The cross-fitted mean: unbiased with the claimed spread, where an in-sample one claims too little."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.crossfit import CrossFit, Options, Propagated, combine
from coronaryuq.estimation.estimators.influence import Between


def test_long_tails_widen_the_interval_and_well_known_propagation_narrows_it():
    rng = generator(4, "tails")
    flat = rng.uniform(-1, 1, 40)
    tailed = flat.copy()
    tailed[0] = 12.0
    fold = np.arange(40) % 5
    empty = [Propagated(np.zeros(1)) for _ in range(5)]

    def factor(y, blocks, held):
        got = combine("", CrossFit(y, held, blocks, fold), 40, Options(beta=1.0))
        return got.interval.half_width / got.std

    none = np.zeros(40)
    assert factor(flat, empty, none) == pytest.approx(2.0227, abs=0.02)
    assert factor(tailed, empty, none) > 2.5
    wide = [Propagated(rng.normal(0, 100, 20)) for _ in range(5)]
    assert factor(tailed, wide, none) == pytest.approx(1.96, abs=0.01)


def test_a_corner_without_runs_adds_no_more_than_the_spread_of_the_quantity():
    """Two rivals may be any distance apart there; a conditional mean misses no more than the mean does."""
    draw, fold = generator(4, "corner"), np.arange(30) % 5
    g = draw.normal(size=30)
    fit = CrossFit(g + 0.1 * draw.normal(size=30), g, [Propagated(draw.normal(size=40)) for _ in range(5)], fold)

    def residual(factor):
        between = Between(0.0, 0.0, np.zeros(30), factor)
        return combine("", fit, 30, Options(beta=1.0, between=between)).residual_variance

    assert residual(3.0) == pytest.approx(3 * residual(1.0))
    assert residual(1e6) == pytest.approx(np.var(fit.y, ddof=1) / 30)


def test_without_a_control_variate_it_is_plain_monte_carlo():
    y, fold = generator(4, "plain").normal(3, 1, 30), np.arange(30) % 5
    got = combine("MC", CrossFit(y, np.zeros(30), [Propagated(np.zeros(1))] * 5, fold), 30, Options(beta=0.0))
    assert got.mean == pytest.approx(y.mean()) and got.std == pytest.approx(y.std(ddof=1) / np.sqrt(30))


def test_in_sample_control_variates_fail_where_cross_fitted_ones_hold():
    """Fourteen regressors on 25 runs: the in-sample claim is far too small, which is why nothing here is in-sample."""
    ratio = []
    for fitted_out_of_sample in (False, True):
        errors, claims = [], []
        for trial in range(200):
            rng = generator(9, "in-sample", trial)
            x, y = rng.normal(size=(25, 14)), rng.normal(size=25)
            fold = np.arange(25) % 5 if fitted_out_of_sample else None
            error, claim = _regression(x, y, fold)
            errors.append(error)
            claims.append(claim)
        ratio.append(np.sqrt(np.mean(claims)) / np.std(errors))
    assert ratio[0] < 0.6 < 0.8 < ratio[1]


def _regression(x, y, fold):
    held = np.empty(len(y))
    parts = [(np.ones(len(y), bool),) * 2] if fold is None else [(fold != k, fold == k) for k in range(5)]
    mean = 0.0
    for train, test in parts:
        design = np.column_stack([np.ones(train.sum()), x[train]])
        coefficients = np.linalg.lstsq(design, y[train], rcond=None)[0]
        held[test] = coefficients[0] + x[test] @ coefficients[1:]
        mean += test.mean() * (np.mean(y[test] - held[test]) + coefficients[0])
    return mean, np.var(y - held, ddof=1) / len(y)
