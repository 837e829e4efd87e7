"""Confirmation: each of several effects must add evidence, by all data, given the others."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.evidence import PossibleNoise
from coronaryuq.discrepancy.selection.candidates import Candidate, Round, round_of
from coronaryuq.discrepancy.selection.confirmation import confirm
from support.hypotheses import assume
from support.linear_problem import here, linear_problem

ROWS, NUISANCES, PRIOR = 120, 2, -5.0
FITTED = np.arange(ROWS) < 80
FIRST, LATER = here("first"), here("later")


def case(number, fitted, held_out, size_there=1.0, kept_out=True):
    """Two effects with unit size; `later` has these traces (noise sd) in the fitted and in the held-out data.

    size_there: its size in the held-out data.
    """
    random = generator(5, "test", "borne out", number)
    design = random.standard_normal((ROWS, NUISANCES))
    first, later = 2.0 * random.standard_normal((2, ROWS))[0], random.standard_normal(ROWS)
    for rows, trace in ((FITTED, fitted), (~FITTED, held_out)):
        later[rows] *= trace / np.linalg.norm(later[rows])
    y = first + later * np.where(FITTED, 1.0, size_there) + random.standard_normal(ROWS)
    conditions = np.where(FITTED, "rest", "half dilated")
    return linear_problem(design, {FIRST: first, LATER: later}, y, conditions, ["half dilated"] if kept_out else [])


def checked(problem):
    """The effects that are confirmed, and the rounds of both."""
    hypothesis = assume(FIRST, LATER)
    fit = problem.calibrate(hypothesis)
    candidates = [Candidate(placed, PRIOR, fit=fit) for placed in hypothesis]
    rounds = tuple(Round([], candidate, [candidate]) for candidate in candidates)
    kept, refit, rounds = confirm(problem, hypothesis, fit, rounds)
    assert len(refit.z) == NUISANCES + len(kept)
    return list(kept), rounds


@pytest.mark.parametrize("held_out", [True, False])
def test_confirmed_effects_stay_with_their_gains(held_out):
    kept, rounds = checked(case(0, 10.0, 8.0, kept_out=held_out))
    assert kept == [FIRST, LATER]
    assert all(entry.evidence_gain > 5.0 for entry in rounds)
    assert all((entry.held_out_gain > 5.0) == held_out for entry in rounds), "no data are counted twice"
    assert round_of(rounds, LATER).evidence_gain < round_of(rounds, FIRST).evidence_gain


def test_no_data_are_held_out_where_there_are_none_whatever_the_noise_may_be():
    """The evidence of the fitted data and of all data are averaged over the same noises."""
    problem = case(0, 10.0, 8.0, kept_out=False)
    none = problem.forward.noise_shapes
    noises = tuple(PossibleNoise(0.0, np.full(ROWS, variance), none) for variance in (0.0, 8.0))
    kept, rounds = checked(replace(problem, noises={"flow": noises}))
    assert kept == [FIRST, LATER]
    assert all(abs(entry.held_out_gain) < 1e-6 < entry.evidence_gain for entry in rounds)


def test_an_effect_outweighed_by_held_out_data_is_removed():
    """A trace of 6, 18 nats less Occam's share, against 8 noise sd of it where there is none."""
    kept, (first, later) = checked(case(1, 6.0, 8.0, size_there=0.0))
    assert kept == [FIRST]
    assert later.accepted is None and later.refuted.placed == LATER
    assert first.held_out_gain is None and np.isinf(first.evidence_gain)


@pytest.mark.slow
def test_weak_effects_that_are_there_are_seldom_removed():
    """Traces of 6 and, held out, 4: in 300 trials in no more than 3 % of them, four standard errors allowed."""
    trials, level = 300, 0.03
    removed = sum(LATER not in checked(case(number, 6.0, 4.0))[0] for number in range(trials))
    assert removed / trials < level + 4.0 * np.sqrt(level * (1.0 - level) / trials)
