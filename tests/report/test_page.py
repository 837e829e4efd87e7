"""Numbers on the page are rounded as their error deserves, warnings stand once, costs add up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.report import page


@given(st.floats(-1e3, 1e3), st.floats(1e-5, 1e3))
def test_ends_of_an_interval_stay_apart_and_near(middle, half):
    low, high = page.interval(middle - half, middle + half)
    assert float(low) < float(high)
    assert abs(float(low) - (middle - half)) <= 0.05 * 2 * half + 1e-6


@pytest.mark.parametrize(
    ("value", "text"), [(0.81234, "0.812"), (None, "–"), (float("nan"), "–"), (12345.6, "1.23e+04")]
)
def test_numbers_have_three_digits_or_a_dash(value, text):
    assert page.number(value) == text


def test_a_warning_stands_once_and_is_named_by_number():
    notes = page._Notes()
    assert notes.numbers(["a", "b"]) == "[1] [2]"
    assert notes.numbers(["b", "c"]) == "[2] [3]"
    assert notes.texts == ["a", "b", "c"]


def test_costs_are_those_of_each_jobs_last_attempt(tmp_path):
    (tmp_path / "flow3d").mkdir()
    line = "flow3d_batch {}: done; cost: wall {} s, cpu {} s, memory {} MB\n"
    (tmp_path / "flow3d" / "batch_0.log").write_text(
        line.format(0, "9.00", "8.00", 100) + line.format(0, "3.00", "2.00", 90)
    )
    (tmp_path / "flow3d" / "batch_1.log").write_text(line.format(1, "5.00", "4.00", 120))
    (tmp_path / "case.log").write_text("case: started\n")
    flow3d, total = page._costs(tmp_path)
    assert flow3d == {"name": "flow3d", "jobs": 2, "wall": "8", "cpu": "6", "memory": "120"}
    assert (total["name"], total["jobs"], total["cpu"]) == ("all", 2, "6")


@pytest.mark.parametrize(("low", "high", "kind"), [(0.92, 0.97, "bad"), (0.01, 0.06, "good"), (0.42, 0.47, "warn")])
def test_the_verdict_follows_the_whole_interval(low, high, kind):
    assert page._verdict({"low": low, "high": high})["class"] == kind


def test_a_narrow_interval_of_a_probability_gets_a_decimal():
    narrow = page._probability({"value": 0.031, "low": 0.027, "high": 0.035})
    wide = page._probability({"value": 0.02, "low": -0.01, "high": 0.11})
    assert narrow == {"value": "3.1 %", "low": "2.7 %", "high": "3.5 %"}
    assert wide == {"value": "2 %", "low": "0 %", "high": "11 %"}


@pytest.mark.parametrize(("value", "text"), [(0.5, "0.50"), (-0.953, "-0.953"), (0.99962, "0.99962"), (None, "–")])
def test_a_correlation_keeps_its_nines(value, text):
    assert page.correlation(value) == text


def test_only_outlets_clear_of_zero_are_named_as_drivers():
    sobol = {
        "BC_a": {"value": 0.2, "low": 0.1, "high": 0.3},
        "BC_b": {"value": 0.5, "low": 0.4, "high": 0.6},
        "BC_c": {"value": 0.3, "low": 0.0, "high": 0.6},
    }
    assert page._drivers(sobol, {"BC_b": "D1 (lca3)"}) == "D1 (lca3) 50 %, BC_a 20 %"


def test_quantiles_with_few_runs_beyond_them_say_so():
    quantiles = {end: {"value": 0.8, "warning": "some 5 of 100 runs lie beyond it"} for end in ("0.95", "0.05")}
    said = "5 % and 95 % quantile: some 5 of 100 runs lie beyond it."
    assert page._rare(quantiles | {"0.50": {"value": 0.8}}) == said
    assert page._rare({"0.50": {"value": 0.8}}) == ""


def test_the_spread_over_draws_is_told_by_its_outermost_quantiles():
    quantiles = {key: {"value": value} for key, value in (("0.50", 0.8), ("0.95", 0.88), ("0.05", 0.71))}
    assert page._draws(quantiles) == "90 % of draws: 0.71 to 0.88"
