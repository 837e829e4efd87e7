"""What is said of a vessel follows its intervals."""

import pytest

from coronaryuq.report import vessels


@pytest.mark.parametrize(("low", "high", "kind"), [(0.92, 0.97, "bad"), (0.01, 0.06, "good"), (0.42, 0.47, "warn")])
def test_the_verdict_follows_the_whole_interval(low, high, kind):
    assert vessels._verdict({"low": low, "high": high})["class"] == kind


def test_a_narrow_interval_of_a_probability_gets_a_decimal():
    narrow = vessels._probability({"value": 0.031, "low": 0.027, "high": 0.035})
    wide = vessels._probability({"value": 0.02, "low": -0.01, "high": 0.11})
    assert narrow == {"value": "3.1 %", "low": "2.7 %", "high": "3.5 %"}
    assert wide == {"value": "2 %", "low": "0 %", "high": "11 %"}


def test_only_outlets_clear_of_zero_are_named_as_drivers():
    sobol = {
        "BC_a": {"value": 0.2, "low": 0.1, "high": 0.3},
        "BC_b": {"value": 0.5, "low": 0.4, "high": 0.6},
        "BC_c": {"value": 0.3, "low": 0.0, "high": 0.6},
    }
    assert vessels._drivers(sobol, {"BC_b": "D1 (lca3)"}) == "D1 (lca3) 50 %, BC_a 20 %"


def test_quantiles_with_few_runs_beyond_them_say_so():
    quantiles = {end: {"value": 0.8, "warning": "some 5 of 100 runs lie beyond it"} for end in ("0.95", "0.05")}
    said = "5 % and 95 % quantile: some 5 of 100 runs lie beyond it."
    assert vessels._rare(quantiles | {"0.50": {"value": 0.8}}) == said
    assert vessels._rare({"0.50": {"value": 0.8}}) == ""


def test_the_spread_over_draws_is_told_by_its_outermost_quantiles():
    quantiles = {key: {"value": value} for key, value in (("0.50", 0.8), ("0.95", 0.88), ("0.05", 0.71))}
    assert vessels._draws(quantiles) == "90 % of draws: 0.71 to 0.88"
