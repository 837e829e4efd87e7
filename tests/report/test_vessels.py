"""What is said of a vessel follows its intervals."""

import pytest

from coronaryuq.estimation.results import Probability
from coronaryuq.report import vessels
from support.estimates import value


def probability(middle, low, high):
    return Probability(0.8, middle, 0.01, low, high, 0.95)


@pytest.mark.parametrize(("low", "high", "kind"), [(0.92, 0.97, "bad"), (0.01, 0.06, "good"), (0.42, 0.47, "warn")])
def test_the_verdict_follows_the_whole_interval(low, high, kind):
    assert vessels._verdict(probability((low + high) / 2, low, high))["class"] == kind


def test_a_narrow_interval_of_a_probability_gets_a_decimal():
    narrow = vessels._probability(probability(0.031, 0.027, 0.035))
    wide = vessels._probability(probability(0.02, -0.01, 0.11))
    assert narrow == {"value": "3.1 %", "low": "2.7 %", "high": "3.5 %"}
    assert wide == {"value": "2 %", "low": "0 %", "high": "11 %"}


def test_only_outlets_clear_of_zero_are_named_as_drivers():
    sobol = {
        "BC_a": value(0.2, 0.1, 0.3),
        "BC_b": value(0.5, 0.4, 0.6),
        "BC_c": value(0.3, 0.0, 0.6),
    }
    assert vessels._drivers(sobol, {"BC_b": "D1 (lca3)"}) == "D1 (lca3) 50 %, BC_a 20 %"


def test_quantiles_with_few_runs_beyond_them_say_so():
    few = "only about 5 of 100 runs lie beyond it"
    quantiles = {end: value(0.8, warning=few) for end in ("0.95", "0.05")}
    assert vessels._rare(quantiles | {"0.50": value(0.8)}) == f"5 % and 95 % quantile: {few}."
    assert vessels._rare({"0.50": value(0.8)}) == ""


def test_the_spread_over_draws_is_told_by_its_outermost_quantiles():
    quantiles = {"0.50": value(0.8), "0.95": value(0.88), "0.05": value(0.71)}
    assert vessels._draws(quantiles) == "90 % of draws: 0.71 to 0.88"
