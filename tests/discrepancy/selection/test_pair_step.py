"""Pair step: two effects that are right together, where no exchange of one of them helps."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.selection.backward_step import backward_step
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.pair_step import _promising, pair_step
from coronaryuq.discrepancy.selection.score_test import screen
from support.hypotheses import assume
from support.linear_problem import here, linear_problem

ROWS, PRIOR = 120, -3.0


class Case:
    """Effects a and b were hidden, and e besides if `third`; c, less two of d, is nearly the sum of a and b.

    twins: number of further effects that are nearly b.
    """

    def __init__(self, twins: int = 0, third: bool = False):
        random = generator(4, "test", "pair step")
        self.design = random.standard_normal((ROWS, 2))
        a, b, d, e, own, noise = random.standard_normal((6, ROWS))
        self.along = {"a": a, "b": b, "c": a + b + 2.0 * d, "d": d + 0.3 * own, "e": e}
        self.along |= {f"b{k}": b + 0.01 * random.standard_normal(ROWS) for k in range(twins)}
        self.placed = {name: here(name) for name in self.along}
        effects = {self.placed[name]: along for name, along in self.along.items()}
        self.problem = linear_problem(self.design, effects, 1.2 * (a + b + third * e) + noise)
        self.candidates = [Candidate(placed, PRIOR, z_score=10.0, guess=1.0) for placed in self.placed.values()]

    def step(self, present, removed):
        """Return names, fit and rounds after a pair step, and the fit before."""
        by_name = {candidate.effect.name: candidate for candidate in self.candidates}
        hypothesis = assume(*(self.placed[name] for name in present))
        fit = self.problem.calibrate(hypothesis)
        rounds = tuple(Round([], by_name[name], [by_name[name]], self.candidates) for name in present)
        gone = tuple(self.placed[name] for name in removed)
        found, after, rounds = pair_step(self.problem, hypothesis, fit, rounds, gone, self.candidates)
        return found, after, rounds, fit


def names(hypothesis):
    return {effect.name for effect, _ in hypothesis}


def test_two_effects_give_way_to_two_that_are_right_together():
    case = Case()
    hypothesis, fit, rounds, before = case.step("cd", "cd")
    assert names(hypothesis) == {"a", "b"} and fit.evidence > before.evidence + 10.0
    assert [entry.accepted.placed for entry in rounds] == list(hypothesis)
    for entry in rounds:
        assert entry.others == hypothesis.without(entry.accepted.placed)
        # Nothing else was fitted beside the other one.
        assert [member.share for member in entry.members] == [1.0]


def test_no_exchange_of_one_of_them_would_do():
    case = Case()
    hypothesis, fit, rounds, _ = case.step("cd", "cd")
    present = assume(case.placed["c"], case.placed["d"])
    by_name = {candidate.effect.name: candidate for candidate in case.candidates}
    rounds = tuple(Round([], by_name[name], [by_name[name]], case.candidates) for name in "cd")
    kept, _, _ = backward_step(case.problem, present, case.problem.calibrate(present), rounds, recent=0)
    assert names(kept) == {"c", "d"}


def test_a_third_effect_stays():
    hypothesis, _, rounds, _ = Case(third=True).step("cde", "cd")
    assert names(hypothesis) == {"a", "b", "e"}
    assert sorted(entry.accepted.effect.name for entry in rounds) == ["a", "b", "e"]


def test_the_right_pair_and_its_class_stay_without_a_fit(monkeypatch):
    case = Case(twins=3)
    by_name = {candidate.effect.name: candidate for candidate in case.candidates}
    present = assume(case.placed["a"], case.placed["b"])
    fit = case.problem.calibrate(present)
    members = [candidate for name, candidate in by_name.items() if name.startswith("b")]
    rounds = (
        Round([], by_name["a"], [by_name["a"]], case.candidates),
        Round([], by_name["b"], members, case.candidates),
    )
    fits = []
    monkeypatch.setattr(type(case.problem), "calibrate_each", lambda self, wanted: fits.extend(wanted) or [])
    kept, same, unchanged = pair_step(case.problem, present, fit, rounds, present.effects, case.candidates)
    assert (kept, same, unchanged) == (present, fit, rounds) and not fits


def test_without_another_visible_candidate_the_pair_stays():
    case = Case()
    case.candidates = [c for c in case.candidates if c.effect.name in "cd"]
    present = assume(case.placed["c"], case.placed["d"])
    fit = case.problem.calibrate(present)
    rounds = tuple(Round([], c, [c], case.candidates) for c in case.candidates)
    for candidates in ([], case.candidates[:1], case.candidates):
        kept, same, unchanged = pair_step(case.problem, present, fit, rounds, present.effects, candidates)
        assert (kept, same, unchanged) == (present, fit, rounds)


def test_pairs_are_ranked_at_their_most_probable_sizes():
    """Weak effects stay near their prior's mean: of a linear pair, the guess is the posterior mean."""
    random = generator(6, "test", "pair step")
    a, b, noise = random.standard_normal((3, ROWS))
    first, second = here("a"), here("b")
    problem = linear_problem(
        np.zeros((ROWS, 1)), {first: 0.1 * a, second: 0.1 * b + 0.05 * a}, 0.1 * a + 0.2 * b + noise
    )
    scored = screen(problem, problem.calibrate(PLAIN), PLAIN, [Candidate(first, PRIOR), Candidate(second, PRIOR)])
    ((one, other),) = _promising(problem.calibrate(PLAIN), scored, -np.inf, [set(), set()])
    wanted = problem.calibrate(assume(first, second)).z[1:]
    assert [one.guess, other.guess] == pytest.approx(wanted, abs=1e-3)
