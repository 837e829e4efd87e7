"""Effects are found to which the model has adapted: exchanged channels, and values that are recalibrated."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide, read_case
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.selection.adapted import exchange
from coronaryuq.discrepancy.selection.candidates import all_candidates, shortlist
from coronaryuq.discrepancy.selection.score_test import screen

SYMMETRIC = 101
"""Seed whose flows in the two branches of the tree are exchanged."""


@pytest.fixture(scope="module")
def hidden(tmp_path_factory):
    """The true exchange, and the problem; every channel is read at times of its own."""
    folder = tmp_path_factory.mktemp("exchanged")
    truth, _ = hide(Case(("exchanged_flows",), "medium", "nominal", SYMMETRIC), open_loop(), folder)
    (placed,) = truth.hypothesis
    return placed, read_case(folder)


@pytest.fixture(scope="module")
def scored(hidden):
    """All exchanges, and a few other candidates, about the recalibrated model."""
    _, problem = hidden
    some = [c for c in all_candidates(problem, PLAIN) if c.effect.exchanges or c.effect.name.startswith("flow")]
    base = problem.calibrate(PLAIN)
    return base, {c.placed.key: c for c in screen(problem, base, PLAIN, some)}


def test_rows_are_exchanged_within_their_condition_and_between_the_two_channels(hidden):
    placed, problem = hidden
    (candidate,) = [c for c in all_candidates(problem, PLAIN) if c.placed.key == placed.key]
    found = exchange(problem, candidate)
    owner, pair = problem.owner[problem.train], set(placed.place.split(" and "))
    for number in np.unique(owner):
        own, series = owner == number, problem.forward.measured[number]
        (other,) = np.unique(owner[found.before[own]])
        partner = problem.forward.measured[other]
        assert partner.condition == series.condition and partner.quantity == series.quantity
        moved = series.quantity == "flow" and series.location in pair
        assert ({partner.location, series.location} == pair) == moved
        assert (other != number) == moved


def test_a_smooth_function_is_read_at_the_other_channels_times(hidden):
    placed, problem = hidden
    (candidate,) = [c for c in all_candidates(problem, PLAIN) if c.placed.key == placed.key]
    measured = problem.forward.measured
    phase = np.concatenate([np.zeros(1) if s.time is None else s.time / s.period for s in measured])
    number = problem.owner[problem.train]
    values = np.sin(2.0 * np.pi * phase[problem.train]) + number
    found = exchange(problem, candidate)
    moved = found.of(values) - np.sin(2.0 * np.pi * phase[problem.train])
    assert moved == pytest.approx(number[found.before], abs=0.02)


def test_the_estimate_is_the_evidence_of_a_full_fit(hidden, scored):
    placed, problem = hidden
    base, candidates = scored
    found = candidates[placed.key]
    (fit,) = problem.calibrate_each([(PLAIN.with_(placed), np.append(np.zeros(problem.count), 0.0))])
    assert found.z_score < RULE.shortlist_score, "about the adapted model the score test sees nothing"
    assert fit.evidence - base.evidence > 50.0
    assert found.estimate == pytest.approx(fit.evidence, abs=5.0)


def test_it_is_shortlisted_first(hidden, scored):
    placed, _ = hidden
    base, candidates = scored
    assert shortlist(candidates.values(), 3)[0].placed.key == placed.key


def test_other_exchanges_gain_nothing(hidden, scored):
    placed, _ = hidden
    base, candidates = scored
    others = [c for c in candidates.values() if c.effect.name == "exchanged_flows" and c.placed.key != placed.key]
    assert others and max(c.estimate for c in others) < base.evidence


def test_a_bed_to_whose_resistance_all_parameters_adapted_is_estimated_as_by_a_full_fit(tmp_path):
    """One of three beds has 0.3 times its resistance: about the fit, the other two had seemed to be off."""
    truth, _ = hide(Case(("bed_resistance",), "medium", "nominal", 99430), open_loop(), tmp_path)
    problem, (placed,) = read_case(tmp_path), truth.hypothesis
    base = problem.calibrate(PLAIN)
    some = [c for c in all_candidates(problem, PLAIN) if c.effect.recalibrated]
    best = max(screen(problem, base, PLAIN, some), key=lambda one: one.estimate)
    (fit,) = problem.calibrate_each([(PLAIN.with_(placed), np.append(np.zeros(problem.count), -1.0))])
    assert best.placed.key == placed.key and fit.evidence - base.evidence > 10.0
    assert best.estimate == pytest.approx(fit.evidence, abs=3.0)
