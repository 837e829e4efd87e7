"""Silently wrong answers are found, and their correction works."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis import diagnostics
from coronaryuq.estimation.estimators import dependence
from coronaryuq.estimation.estimators.crossfit import CrossFit, Propagated, combine
from coronaryuq.estimation.runs.table import read_runs
from support import three_levels
from support.runs import runs_of


def runs(shift=0.0, n=200, m=2000):
    rng = generator(3, "diagnostics", str(shift))
    x, more = rng.normal(shift, 0.3, (n, 3)), rng.normal(0, 0.3, (m, 3))
    return runs_of(np.exp(x), {"y": x.sum(axis=1)}, {"q": x[:, 0]}, np.exp(more))


def test_inputs_of_one_distribution_pass_and_shifted_ones_do_not():
    assert diagnostics.different_inputs(runs()) is None
    assert diagnostics.different_inputs(runs(0.15)).code == "inputs differ"


@pytest.mark.slow
def test_false_alarms_are_rare():
    alarms = 0
    for trial in range(200):
        rng = generator(3, "alarm", trial)
        base = runs()
        base = replace(
            base, theta=np.exp(rng.normal(0, 0.3, (200, 3))), theta_more=np.exp(rng.normal(0, 0.3, (500, 3)))
        )
        alarms += diagnostics.different_inputs(base) is not None
    assert alarms <= 3


def test_the_published_pilot_and_propagation_inputs_differ(menon):
    assert diagnostics.different_inputs(read_runs(menon)) is not None


def test_balancing_weights_move_the_pilot_onto_the_propagation_means():
    shifted = runs(0.1)
    weights = diagnostics.balancing_weights(shifted)
    assert weights.mean() == pytest.approx(1)
    moved = np.average(np.log(shifted.theta), axis=0, weights=weights)
    np.testing.assert_allclose(moved, np.log(shifted.theta_more).mean(axis=0), atol=1e-6)


def test_samples_that_are_too_different_are_not_reweighted():
    assert (diagnostics.balancing_weights(runs(3.0)) == 1).all()


def test_resampled_inputs_outside_the_training_box_are_found():
    inside = runs().theta
    assert diagnostics.outside_support(inside, inside, ("a", "b", "c")) is None
    beyond = inside.copy()
    beyond[:40, 2] = 10
    assert "most of them in c" in diagnostics.outside_support(beyond, inside, ("a", "b", "c")).text


def test_a_model_without_gain_carries_a_warning():
    assert diagnostics.without_gain(0.05, 100, "MFMC") is not None
    assert diagnostics.without_gain(0.5, 100, "MFMC") is None
    assert diagnostics.without_gain(-0.9, 100, "crossfit-GP") is not None


def test_a_run_with_most_of_the_squared_residuals_is_reported():
    left = generator(3, "dominated").normal(size=40)
    names = tuple(f"sample_{i}" for i in range(40))
    assert diagnostics.dominated(left, names) is None and diagnostics.dominated(0 * left, names) is None
    left[7] = 30.0
    assert diagnostics.dominated(left, names).text.startswith("sample_7 alone has 9")


def estimate(y, held_out=None):
    held_out = np.zeros(len(y)) if held_out is None else held_out
    return combine("MC", CrossFit(y, held_out, [Propagated(np.zeros(1))], np.zeros(len(y), int)), len(y))


def test_a_long_tail_carries_a_warning_and_a_normal_sample_none():
    random = generator(4, "tail")
    assert diagnostics.skewed(estimate(random.normal(size=50))) is None
    assert diagnostics.skewed(estimate(np.exp(1.2 * random.normal(size=50)))).code == "long tail"


def test_no_interval_is_said_to_lose_more_than_all_of_its_coverage():
    one = np.zeros(50)
    one[7] = 1.0
    extreme = replace(estimate(one + 1e-3 * np.arange(50.0)), skewness=17.0)
    assert "lose a large, unknown part of its coverage" in diagnostics.skewed(extreme).text


def test_a_quantity_that_hardly_varies_carries_a_warning():
    y = np.full(60, 0.9)
    y[3] = 0.7
    assert "all but 1 of 60 runs" in diagnostics.constant(y).text
    assert diagnostics.constant(np.arange(60.0)) is None and diagnostics.constant(np.arange(60) % 2) is None


def test_a_small_pilot_states_what_it_may_have_missed():
    assert "less than 12 %" in diagnostics.unseen(25).text and diagnostics.unseen(101) is None


def test_two_estimates_far_apart_carry_a_warning_and_equal_ones_none():
    y = generator(5, "apart").normal(size=100)
    one, other = estimate(y), estimate(y + 0.3 * generator(6, "apart").normal(size=100))
    assert diagnostics.disagreement({"MC": one, "MFMC": other}, "MC") is None
    moved = replace(other, mean=other.mean + 0.2)
    assert "MC" in diagnostics.disagreement({"MC": one, "MFMC": moved}, "MC").text
    assert diagnostics.disagreement({"MC": one}, "MC") is None


def test_dependent_samples_are_reported_and_not_taken_for_other_inputs():
    random = generator(7, "dependent")
    steps = random.normal(size=(2000, 3))
    chain = np.zeros((2000, 3))
    for k in range(1, 2000):
        chain[k] = 0.98 * chain[k - 1] + 0.2 * steps[k]
    both = replace(runs(), theta_more=np.exp(0.3 * chain))
    found = dependence.find(both)
    assert "autocorrelated" in diagnostics.dependent(found).text
    assert diagnostics.different_inputs(both, found) is None


def test_many_failed_coarse_runs_carry_a_warning():
    assert diagnostics.coarse_failures(three_levels.campaign(30, 90, 100, failed=0.2)) is not None
    assert diagnostics.coarse_failures(three_levels.campaign(30, 90, 100)) is None
