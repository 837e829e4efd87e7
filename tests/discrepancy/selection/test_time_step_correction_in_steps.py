"""Candidates are compared with the time-step error corrected at their own fits."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.selection.backward_step import compare_again
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.forward_step import forward_step
from coronaryuq.discrepancy.selection.search import evidence_p_value
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here, linear_problem

ROWS, NUISANCES = 60, 3
RIGHT, NEIGHBOUR, OTHER = here("right"), here("neighbour"), here("other")


def with_left_out(left_out):
    """A problem whose coarse steps leave these changes (N,) out of an effect of unit size."""

    class Ringing(LinearProblem):
        def corrected(self, hypothesis, fit):
            other = replace(self)
            other.change = np.zeros(ROWS)
            for placed in hypothesis:
                other.change = other.change + hypothesis.sizes(fit.z, placed)[0] * left_out.get(placed, 0.0)
            return other, other.calibrate(hypothesis)

    return Ringing


def test_a_candidate_is_compared_with_the_time_steps_corrected_at_its_own_fit():
    """Coarse steps leave a ringing out of the right effect, and without it a neighbour is as near."""
    random = generator(6, "test", "evidence")
    design = random.standard_normal((ROWS, NUISANCES))
    right, ringing, own = random.standard_normal((3, ROWS))
    y = 2.0 * (right + 0.5 * ringing) + random.standard_normal(ROWS)
    responses = {RIGHT: right, NEIGHBOUR: right + 0.5 * ringing + 0.4 * own}
    problem = linear_problem(design, responses, y, kind=with_left_out({RIGHT: 0.5 * ringing}))
    both = [
        Candidate(placed, -1.0, z_score=9.0, guess=1.0, fit=problem.calibrate(assume(placed)))
        for placed in (NEIGHBOUR, RIGHT)
    ]
    first = Round(sorted(both, key=lambda c: -c.log_weight), both[0], [both[0]], both)
    assert 0.0 < both[0].log_weight - both[1].log_weight < RULE.contender_gap
    _, hypothesis, fit, decided = compare_again(problem, problem, first, PLAIN, both[0].fit)
    assert hypothesis == assume(RIGHT) and fit is decided.accepted.fit
    assert decided.accepted.placed == RIGHT
    assert decided.accepted.share > 100.0 * decided.shortlist[1].share
    assert [c.placed for c in decided.members] == [RIGHT]


def test_an_effect_that_the_time_steps_caused_is_given_up_again():
    """Other effects of the search stay, whatever the round knew of them."""
    random = generator(8, "test", "evidence")
    basis = np.linalg.qr(random.standard_normal((ROWS, NUISANCES + 3)))[0]
    design, (true, ringing, besides) = 3.0 * basis[:, :NUISANCES], 4.0 * basis[:, NUISANCES:].T
    problem_with = {RIGHT: true + ringing, OTHER: besides}

    class Rung(LinearProblem):
        """Coarse steps ring like the data; with that corrected the effect explains next to nothing."""

        def corrected(self, hypothesis, fit):
            other = replace(self)
            other.change = -2.0 * ringing if RIGHT in hypothesis else np.zeros(ROWS)
            return other, other.calibrate(hypothesis)

    problem = linear_problem(design, problem_with, 2.0 * ringing + 2.0 * besides, kind=Rung)
    hypothesis = assume(OTHER, RIGHT)
    named = Candidate(RIGHT, -1.0, z_score=9.0, guess=1.0, fit=problem.calibrate(hypothesis))
    current = Round([named], named, [named], [named], others=assume(NEIGHBOUR, OTHER))
    assert named.log_weight - problem.calibrate(assume(OTHER)).evidence > problem.settings.min_log_odds
    after, fit = problem.corrected(hypothesis, named.fit)
    plain, kept, without, decided = compare_again(problem, after, current, assume(OTHER), fit)
    assert kept == assume(OTHER) and decided.accepted is None
    assert plain.change == pytest.approx(0.0) and len(without.z) == NUISANCES + 1


def test_an_effect_distorted_by_coarse_steps_is_found_with_its_own_correction():
    """The evidence with its own steps raises the alarm, and it is named by that."""
    random = generator(7, "test", "evidence")
    basis = np.linalg.qr(random.standard_normal((ROWS, NUISANCES + 2)))[0]
    design, (right, aside) = 3.0 * basis[:, :NUISANCES], np.sqrt(8.0) * basis[:, NUISANCES:].T
    kind = with_left_out({RIGHT: -1.5 * aside})
    problem = linear_problem(design, {RIGHT: right + 1.5 * aside}, 3.0 * right, kind=kind)
    base, coarse = problem.calibrate(PLAIN), problem.calibrate(assume(RIGHT))
    own, better = problem.corrected(assume(RIGHT), coarse)
    assert problem.missed(own.change) > RULE.time_step_error and better.evidence > coarse.evidence + 3.0
    candidate = Candidate(RIGHT, -9.0, z_score=4.0, guess=1.0, estimate=coarse.evidence)
    expected = min(1.0, np.exp(base.evidence - better.evidence - candidate.log_prior) * RULE.prior_named)
    assert evidence_p_value(problem, base, PLAIN, [candidate]) == pytest.approx(expected) and expected < 0.01
    assert coarse.evidence - base.evidence + candidate.log_prior < problem.settings.min_log_odds
    step = forward_step(problem, base, PLAIN, [candidate], base, problem.settings.min_log_odds)
    assert step.accepted.placed == RIGHT and step.accepted.fit.evidence == pytest.approx(better.evidence)
