"""Sentences name what is meant, with as many digits as needed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.errors import similar
from coronaryuq.core.wording import interval_text, listed, p_text


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.204, 0.191, 0.222, "0.204 (0.191 to 0.222)"),
        (0.0202, 0.0196, 0.0216, "0.0202 (0.0196 to 0.0216)"),
        (0.14, 0.12, 0.161, "0.14 (0.12 to 0.16)"),
        (0.0, 0.0, 0.00571841, "0.000 (0.000 to 0.006)"),
        (11.04, 10.9, 11.2, "11.04 (10.90 to 11.20)"),
        (1234.0, 1060.0, 1410.0, "1230 (1060 to 1410)"),
        (-0.0121, -0.0304, 0.0051, "-0.012 (-0.030 to 0.005)"),
        (3.1e-5, 2.4e-5, 4.2e-5, "3.1e-05 (2.4e-05 to 4.2e-05)"),
        (1.0, 1.0, 1.0, "1 (1 to 1)"),
    ],
)
def test_an_interval_and_its_value_have_the_same_decimals(value, low, high, text):
    assert interval_text(value, low, high) == text


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 10.0))
def test_rounding_moves_no_end_by_more_than_an_eighth_of_the_width(value, share):
    low, high = value * (1.0 - share / 2.0), value * (1.0 + share / 2.0)
    printed = [float(word.strip("()")) for word in interval_text(value, low, high).replace(" to ", " ").split()]
    assert np.abs(np.array(printed) - [value, low, high]).max() <= (high - low) / 8.0 * (1.0 + 1e-6)


def test_lists_and_p_values_read_as_in_a_sentence():
    assert [listed("abc"[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert p_text(0.0) == "p below 1e-300" and p_text(0.0123) == "p = 0.012"


def test_similar_names_are_found_whatever_their_capitals():
    assert similar("LAD_PROX", ["AOP", "lad_prox", "lcx"]).startswith("similar: lad_prox")
    assert similar("zzz", ["AOP"]) == ""
    assert similar("leia:J1", ["lcia:J1", "leia:B1", "reia:J1", "J1:leia"]).startswith("similar: J1:leia, ")
