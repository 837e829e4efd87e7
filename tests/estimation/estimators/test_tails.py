"""Probabilities, quantiles and variance against known values, over repeated trials."""

import numpy as np
import pytest
from scipy.stats import norm

from coronaryuq.bench.estimation.problems import ROW as ANY
from coronaryuq.bench.estimation.problems import Trial, as_design
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import tails
from coronaryuq.estimation.estimators.dependence import Dependence, Segments
from coronaryuq.estimation.estimators.folds import assign
from coronaryuq.estimation.estimators.per_row import predict
from coronaryuq.estimation.surrogates.control_variates import Seen
from support.linear_trials import VARIANCE, N, check, coverage, linear_trials, onset_trials

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("at", [0.0, -1.5])
def test_probabilities_hold_their_claims(at):
    check([tails.probability(d, y, p, at) for d, y, p in linear_trials()], norm.cdf(at / np.sqrt(VARIANCE)))


def holds_its_level(found, truth):
    """At most three binomial standard errors below 95 %: an interval that reaches to what was missed may cover more."""
    return coverage(found, truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found))


@pytest.mark.parametrize("share", [1e-4, 0.001, 0.999, 0.9999])
def test_probabilities_near_zero_and_one_hold_their_claims(share):
    """Few runs or none lie on the far side of the limit, and most samples' predictions say that none does."""
    at = norm.ppf(share) * np.sqrt(VARIANCE)
    found = [tails.probability(d, y, p, at) for d, y, p in linear_trials()]
    assert holds_its_level(found, share)


@pytest.mark.long
def test_an_event_that_no_prediction_shows_and_hardly_a_run_is_within_the_interval():
    """In 2 % of the states y falls far below the limit; the control variate knows nothing of it."""
    trials = onset_trials(0.02)
    found = [tails.probability(d, y, p, -5.0) for d, y, p in trials]
    assert holds_its_level(found, 0.02)
    assert all(value.std > 0.005 for value in found)


def test_the_interval_of_what_no_run_has_shown_follows_the_rule_of_three():
    for design, y, predictions in linear_trials()[:5]:
        none, all_of_them = tails.zones(design, y, predictions, (-8.0,))
        assert none.low == 0 and none.high == pytest.approx(3 / N, rel=0.002)
        assert all_of_them.high == 1 and all_of_them.low == pytest.approx(1 - none.high, abs=1e-12)
        assert all_of_them.complement.high == pytest.approx(none.high, abs=1e-12)


def test_a_zone_that_no_run_has_shown_is_no_more_probable_than_all_up_to_its_end():
    at = norm.ppf(0.03) * np.sqrt(VARIANCE)
    lowest, up_to = [], []
    for design, y, predictions in linear_trials()[:60]:
        lowest.append(tails.zones(design, y, predictions, (-8.0, at))[0].high)
        up_to.append(tails.probability(design, y, predictions, at).high)
    assert np.min(up_to) < 3 / N
    assert (np.array(lowest) <= np.array(up_to) + 1e-12).all()


def test_dependent_runs_count_as_fewer():
    twice = Segments(np.arange(60) // 2, np.arange(60) // 2)
    assert Dependence().effective(60) == pytest.approx(60)
    assert Dependence(pilot=twice).effective(60) == pytest.approx(30)
    assert Dependence(ratio=1 / 60, shared=True).effective(60) == pytest.approx(30)


@pytest.mark.long
@pytest.mark.parametrize("share", [0.5, 0.95])
def test_quantiles_hold_their_claims(share):
    found = [tails.quantile(d, y, p, share) for d, y, p in linear_trials()[:120]]
    truth = norm.ppf(share) * np.sqrt(VARIANCE)
    assert coverage(found, truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found))
    assert abs(np.mean([value.value for value in found]) - truth) < 0.05


@pytest.mark.parametrize("share", [0.052, 0.503, 0.951])
def test_a_quantile_of_a_finite_set_with_nearly_exact_predictions_is_that_of_the_set(share):
    """400 values are wanted, and intervals far narrower than what lies between two of them."""
    rng = generator(5, "beyond", "finite")
    x, more = rng.normal(size=(50, 2)), rng.normal(size=(400, 2))
    trial = Trial(seen_of(x), np.exp(0.1 * x[:, 0]), seen_of(more), more_y=np.exp(0.1 * more[:, 0]))
    design = as_design(trial, assign(50, 10, 5, "finite"))
    got = tails.quantile(design, trial.y, predict(design, ANY), share)
    assert got.holds(np.sort(trial.more_y)[int(share * 400)])
    assert got.high - got.low < 4e-4


def seen_of(x):
    return Seen(x, x[:, 0], x)


def test_the_variance_holds_its_claim():
    check([tails.variance(d, y, p) for d, y, p in linear_trials()], VARIANCE)


@pytest.mark.parametrize("zone", [0, *(pytest.param(zone, marks=pytest.mark.long) for zone in (1, 2))])
def test_probabilities_of_zones_hold_their_claims(zone):
    limits = (-0.4, 0.8)
    truth = np.diff([0.0, *norm.cdf(np.array(limits) / np.sqrt(VARIANCE)), 1.0])[zone]
    check([tails.zones(d, y, p, limits)[zone] for d, y, p in linear_trials()], truth)


def test_zones_add_up_to_one_and_agree_with_the_probability_of_the_highest_limit():
    for design, y, predictions in linear_trials()[:20]:
        found = tails.zones(design, y, predictions, (-2.5, -0.4, 0.8))
        assert sum(zone.value for zone in found) == pytest.approx(1, abs=1e-12)
        assert min(zone.value for zone in found) >= 0
        below = tails.probability(design, y, predictions, 0.8)
        assert found[-1].complement.value == pytest.approx(below.value, abs=1e-12)
        assert found[-1].complement.holds(below.value)
        assert [(zone.above, zone.at_most) for zone in found] == [(None, -2.5), (-2.5, -0.4), (-0.4, 0.8), (0.8, None)]
