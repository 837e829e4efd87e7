"""Sentences name what is meant, with as many digits as needed."""

import pytest

from coronaryuq.core.errors import similar
from coronaryuq.core.wording import interval_text, listed, p_text


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.204, 0.191, 0.222, "0.2 (0.19 to 0.22)"),
        (0.0, 0.0, 0.00571841, "0 (0 to 0.0057)"),
        (11.04, 10.9, 11.2, "11 (10.9 to 11.2)"),
        (1.0, 1.0, 1.0, "1 (1 to 1)"),
    ],
)
def test_an_interval_is_never_rounded_to_its_value(value, low, high, text):
    assert interval_text(value, low, high).startswith(text.split()[0][:2])
    assert interval_text(value, low, high) == text


def test_lists_and_p_values_read_as_in_a_sentence():
    assert [listed("abc"[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert p_text(0.0) == "p below 1e-300" and p_text(0.0123) == "p = 0.012"


def test_similar_names_are_found_whatever_their_capitals():
    assert similar("LAD_PROX", ["AOP", "lad_prox", "lcx"]).startswith("similar: lad_prox")
    assert similar("zzz", ["AOP"]) == ""
