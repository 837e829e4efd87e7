"""Numbers on the page have as many digits as their error justifies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.report import numbers


@given(st.floats(-1e3, 1e3), st.floats(1e-5, 1e3))
def test_rounded_ends_of_an_interval_stay_distinct_and_close(middle, half):
    low, high = numbers.interval(middle - half, middle + half)
    assert float(low) < float(high)
    assert abs(float(low) - (middle - half)) <= 0.05 * 2 * half + 1e-6


@pytest.mark.parametrize(
    ("value", "text"), [(0.81234, "0.812"), (None, "–"), (float("nan"), "–"), (12345.6, "1.23e+04")]
)
def test_numbers_have_three_digits_or_are_a_dash(value, text):
    assert numbers.number(value) == text


@pytest.mark.parametrize(("value", "text"), [(0.5, "0.50"), (-0.953, "-0.953"), (0.99962, "0.99962"), (None, "–")])
def test_a_correlation_near_one_is_shown_with_enough_digits(value, text):
    assert numbers.correlation(value) == text
