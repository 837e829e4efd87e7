"""Backward step: every round keeps its own effect, and the class that the later effects leave it."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.selection.backward_step import backward_step
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from support.hypotheses import assume
from support.linear_problem import here, linear_problem

ROWS, NUISANCES, PRIOR = 120, 2, -3.0


class Case:
    """A linear problem with effects a, b and c: c was hidden, a and b together come near to it.

    twins: a and b were hidden, and c is nearly a. copies: so many more effects are nearly a.
    """

    def __init__(self, twins: bool = False, copies: int = 0):
        random = generator(4, "test", "look back")
        design = random.standard_normal((ROWS, NUISANCES))
        a, b, own = random.standard_normal((3, ROWS))
        self.along = {"a": a, "b": b, "c": a + 0.05 * own if twins else a + b + 0.8 * own}
        noise = generator(5, "test", "look back").standard_normal((copies, ROWS))
        self.along |= {f"copy {number}": a + 0.01 * noise[number] for number in range(copies)}
        self.y = 1.5 * (a + b if twins else self.along["c"]) + random.standard_normal(ROWS)
        self.design = design
        self.placed = {name: here(name) for name in self.along}

    @property
    def problem(self):
        return linear_problem(self.design, {self.placed[name]: along for name, along in self.along.items()}, self.y)

    def rounds(self, names, z_score=10.0):
        candidates = [Candidate(placed, PRIOR, z_score=z_score, guess=1.0) for placed in self.placed.values()]
        by_name = {candidate.effect.name: candidate for candidate in candidates}
        return tuple(Round([], by_name[name], [by_name[name]], candidates) for name in names)

    def hypothesis(self, names):
        return assume(*(self.placed[name] for name in names))


def names(hypothesis):
    return [effect.name for effect, _ in hypothesis]


def test_after_a_replacement_the_effect_that_is_no_longer_needed_goes():
    case = Case()
    problem, hypothesis, rounds = case.problem, case.hypothesis("ab"), case.rounds("ab")
    hypothesis, fit, rounds = backward_step(problem, hypothesis, problem.calibrate(hypothesis), rounds)
    assert names(hypothesis) == ["b", "c"]
    assert [entry.accepted.effect.name for entry in rounds] == ["c", "b"]
    replaced = rounds[0]
    assert replaced.accepted is replaced.shortlist[0] and replaced.shortlist[1].effect.name == "a"
    assert replaced.accepted.share > 100.0 * replaced.shortlist[1].share
    assert sum(c.share for c in replaced.shortlist) == pytest.approx(1.0)

    hypothesis, fit, rounds = backward_step(problem, hypothesis, fit, rounds)
    assert names(hypothesis) == ["c"]
    assert rounds[0].accepted.placed == case.placed["c"] and rounds[1].accepted is None
    assert len(fit.z) == NUISANCES + 1


def test_the_class_of_a_kept_effect_is_judged_beside_the_later_ones():
    case = Case(twins=True)
    problem, hypothesis = case.problem, case.hypothesis("ab")
    kept, _, rounds = backward_step(problem, hypothesis, problem.calibrate(hypothesis), case.rounds("ab"))
    first = rounds[0]
    assert kept == hypothesis and first.others == case.hypothesis("b")
    assert [member.effect.name for member in first.members] == ["a", "c"]
    for member in first.members:
        assert member.fit.z == pytest.approx(problem.calibrate(first.others.with_(member.placed)).z)


def test_a_class_holds_more_candidates_than_are_fitted_in_full():
    """And more than the round that named its first member knew of."""
    case = Case(twins=True, copies=RULE.rivals + 4)
    problem, hypothesis = case.problem, case.hypothesis("ab")
    _, _, rounds = backward_step(problem, hypothesis, problem.calibrate(hypothesis), case.rounds("ab"))
    assert {member.effect.name for member in rounds[0].members} == set(case.placed) - {"b"}


@pytest.mark.parametrize(("company", "expected"), [("c", ["b", "c"]), ("a", ["c", "d"])])
def test_a_round_whose_other_effects_were_replaced_scores_all_its_candidates_again(company, expected):
    """What was unlikely beside an effect that is no longer there may be what is missing now."""
    case = Case(twins=True)
    case.along["d"] = case.along["b"] + generator(6, "test", "look back").standard_normal(ROWS)
    case.placed["d"] = here("d")
    case.y = 1.5 * (case.along["c"] + case.along["d"]) + case.y * 0.1
    problem, hypothesis = case.problem, case.hypothesis("bc")
    first, second = case.rounds("bc", z_score=0.0)
    rounds = replace(first, others=case.hypothesis(company)), second
    kept, _, _ = backward_step(problem, hypothesis, problem.calibrate(hypothesis), rounds)
    assert names(kept) == expected


@pytest.mark.parametrize(("odds", "kept"), [(1.5, True), (-1.5, False)])
def test_the_only_effect_left_has_to_be_likelier_than_none_as_in_a_forward_step(odds, kept):
    """And its class is judged beside nothing else, whatever it had been found beside."""
    random, only = generator(7, "test", "look back"), here("only")
    design, along, noise = random.standard_normal((ROWS, NUISANCES)), *random.standard_normal((2, ROWS))

    def fitted(size):
        problem = linear_problem(design, {only: along}, size * along + noise)
        fit = problem.calibrate(assume(only))
        return problem, fit, fit.evidence + PRIOR - problem.calibrate(PLAIN).evidence

    problem, fit, found = min((fitted(size) for size in np.linspace(0.0, 1.0, 400)), key=lambda one: abs(one[2] - odds))
    assert found == pytest.approx(odds, abs=0.3)
    candidate = Candidate(only, PRIOR, z_score=10.0, guess=1.0)
    rounds = (Round([], candidate, [candidate], [candidate], assume(here("gone"))),)
    hypothesis, _, (entry,) = backward_step(problem, assume(only), fit, rounds, recent=0)
    assert (hypothesis == assume(only)) is kept and (entry.accepted is not None) is kept
    assert not kept or entry.others == PLAIN
