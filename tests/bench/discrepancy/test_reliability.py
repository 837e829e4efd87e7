"""Stated probabilities, intervals and traces against what was hidden."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.reliability import (
    BINS,
    brier,
    by_kind,
    confidently_wrong,
    coverage_by_cell,
    detection_curve,
    markdown,
    reliability,
    summary,
)

LEAK = {"network": "open loop", "effect": "side_branch_leak", "strength": "medium", "noise": "nominal", "seed": 1}
LEAK |= {"first": "side_branch_leak", "named": True, "placed": True, "alarmed": True, "abstained": False}
LEAK |= {"covered": True, "probability": 0.99, "cpu_s": 3.0, "cpu_s_made": 1.0}
WRONG = LEAK | {"named": False, "placed": False, "covered": None}
OUTSIDE = WRONG | {"effect": "outside:spasm"}
ABSTAINED = OUTSIDE | {"abstained": True, "probability": None, "first": "outside"}
NOTHING = ABSTAINED | {"effect": "none", "strength": "none", "alarmed": False, "abstained": False, "first": "none"}
SKIPPED = {name: LEAK[name] for name in ("network", "effect", "noise")} | {"strength": "trace 3", "skipped": True}


def test_a_probability_that_holds_is_reliable():
    """Cases right with their stated probability: every bin and the Brier score within five standard errors."""
    random = np.random.default_rng(1)
    stated = random.choice([0.3, 0.7, 0.85, 0.95, 0.99], 4000)
    cases = [(LEAK if random.random() < p else WRONG) | {"probability": float(p)} for p in stated]
    rows = reliability(cases)
    assert [row["to"] for row in rows] == list(BINS[1:]) and sum(row["trials"] for row in rows) == 4000
    for row in rows:
        p = row["stated"]
        assert abs(row["share"] - p) < 5 * np.sqrt(p * (1 - p) / row["trials"])
    found = brier(cases)
    assert abs(found["score"] - np.mean(stated * (1 - stated))) < 5 * found["se"]


@given(st.lists(st.floats(0.0, 1.0), min_size=1))
def test_every_probability_is_in_one_bin(stated):
    assert sum(row["trials"] for row in reliability([LEAK | {"probability": p} for p in stated])) == len(stated)


def test_cases_are_weighted_to_a_mixture_of_truths():
    """Nine right answers of nothing, one wrong name outside: in equal shares half are right, with the weight of few."""
    (row,) = reliability([NOTHING | {"probability": 0.99}] * 9 + [OUTSIDE])
    assert (row["share"], row["trials"]) == (0.9, 10)
    assert row["open_world"]["share"] == pytest.approx(0.5)
    # Kish: (9 / 18 + 1 / 2)^2 over 9 / 18^2 + 1 / 4.
    assert row["open_world"]["trials"] == pytest.approx(3.6)
    (even,) = reliability([NOTHING | {"probability": 0.99}, LEAK, OUTSIDE])
    assert even["open_world"] == {key: pytest.approx(even[key]) for key in even["open_world"]}


def test_answers_without_a_probability_are_left_out():
    assert reliability([NOTHING, ABSTAINED]) == [] and brier([NOTHING])["trials"] == 0
    assert brier([WRONG, NOTHING]) == {"score": pytest.approx(0.99**2), "se": None, "trials": 1}


def test_a_wrong_name_outside_the_library_counts_from_a_probability_of_nine_tenths():
    cases = [OUTSIDE, OUTSIDE | {"probability": 0.89}, ABSTAINED, ABSTAINED, WRONG]
    assert (confidently_wrong(cases)["share"], confidently_wrong(cases)["trials"]) == (0.25, 4)


def test_coverage_of_each_cell():
    other = LEAK | {"effect": "flow_gain", "covered": False}
    rows = coverage_by_cell([LEAK, LEAK, LEAK | {"covered": False}, other, WRONG])
    assert [(row["effect"], row["trials"], row["share"]) for row in rows] == [
        ("side_branch_leak", 3, pytest.approx(2 / 3)),
        ("flow_gain", 1, 0.0),
    ]


def test_the_detection_curve_rises_with_the_trace_and_counts_skipped_cases():
    faint, clear = {"strength": "trace 3"}, {"strength": "trace 50"}
    cases = [LEAK | faint, NOTHING | {"effect": "side_branch_leak"} | faint, LEAK | clear, WRONG | clear, SKIPPED, LEAK]
    low, high = detection_curve(cases)
    assert (low["trace"], low["right"]["share"], low["alarmed"]["share"], low["skipped"]) == (3.0, 0.5, 0.5, 1)
    assert (high["trace"], high["wrong_name"]["share"], high["skipped"]) == (50.0, 0.5, 0)


def test_costs_and_right_answers_by_kind():
    rows = {row["hidden"]: row for row in by_kind([LEAK, WRONG | {"cpu_s": 5.0}, NOTHING, OUTSIDE, SKIPPED])}
    assert set(rows) == {"one effect", "nothing", "outside the library"}
    one = rows["one effect"]
    assert (one["share"], one["trials"], one["skipped"], one["cpu_s"], one["cpu_s_made"]) == (0.5, 2, 1, 4.0, 1.0)


def test_the_tables_for_the_documentation_hold_every_score():
    traced = [LEAK | {"strength": "trace 10"}, SKIPPED]
    text = markdown([LEAK, OUTSIDE, NOTHING, *traced])
    for part in ("| open loop | nominal | one effect | 2 of 2 |", "| 0.97 to 1 | 0.990 | 2 of 3 |", "Brier score"):
        assert part in text
    assert "truth outside the library: 1 of 1" in text and "| 10 | 1 of 1 |" in text
    assert set(summary([LEAK])) >= {"reliability", "brier", "coverage_by_cell", "detection"}
