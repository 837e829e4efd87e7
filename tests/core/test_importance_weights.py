"""Pareto k and smoothed weights of importance ratios."""

import numpy as np
import pytest

from coronaryuq.core.importance_weights import good_enough, pareto_smoothed


@pytest.mark.parametrize("k", [0.3, 0.5, 1.0])
def test_pareto_k_is_that_of_pareto_ratios(k):
    """Ratios u^-k of uniform u have a Pareto tail; the estimate's error follows from repetitions."""
    random = np.random.default_rng(7)
    found = np.array([pareto_smoothed(-k * np.log(random.uniform(size=4000)))[0] for _ in range(60)])
    shrinkage = 10 / (10 + 3 * np.sqrt(4000)) * abs(k - 0.5)
    assert abs(found.mean() - k) < 4.5 * found.std() / np.sqrt(60) + 1.5 * shrinkage + 0.02


def test_pareto_weights_give_the_target_and_failures_none():
    random = np.random.default_rng(8)
    x = 1.3 * random.standard_normal(4000)
    log_ratio = -0.5 * x**2 + 0.5 * (x / 1.3) ** 2
    log_ratio[:400] = -np.inf
    k, weights = pareto_smoothed(log_ratio)
    assert k < 0.5 and weights.sum() == pytest.approx(1)
    assert np.all(weights[:400] == 0)
    assert abs(np.sum(weights * x**2) - 1) < 4.5 * np.sqrt(2 / 3600)


def test_ratios_below_twice_their_mean_are_good_enough_with_any_tail():
    heavy = 2e-4 * 240 / (np.arange(240) + 0.5)
    k, weights = pareto_smoothed(heavy)
    assert k > 0.7 and good_enough(k, weights, 0.5) and good_enough(k, weights, -np.inf)
    k, weights = pareto_smoothed(200 * heavy)
    assert k > 0.7 and not good_enough(k, weights, 0.5)
    assert not good_enough(np.nan, weights, 0.5)
    weights = np.full(240, 1.0)
    for largest, good in ((1.9, True), (2.1, False)):
        weights[0] = largest
        assert good_enough(0.6, weights / weights.sum(), 0.5) == good


def test_pareto_k_needs_enough_runs():
    assert pareto_smoothed(np.zeros(240))[0] == 0
    assert np.isnan(pareto_smoothed(np.linspace(0, 1, 20))[0])
    assert np.isnan(pareto_smoothed(np.where(np.arange(240) < 100, 0.0, -np.inf))[0])
