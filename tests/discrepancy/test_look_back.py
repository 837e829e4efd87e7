"""A look back keeps every round with its own effect, and with the class that the later effects leave it."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.selection.backward_step import look_back
from coronaryuq.discrepancy.selection.candidates import Candidate
from coronaryuq.discrepancy.selection.forward_step import Round
from coronaryuq.discrepancy.selection.refit import RIVALS
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here

ROWS, NUISANCES, PRIOR = 120, 2, -3.0


class Linear(LinearProblem):
    """A linear problem with three effects: c is what was hidden, a and b together come near to it.

    twins: a and b are what was hidden, and c is nearly a.
    """

    def __init__(self, twins: bool = False):
        random = generator(4, "test", "look back")
        self.nuisance = random.standard_normal((ROWS, NUISANCES))
        a, b, own = random.standard_normal((3, ROWS))
        along = {"a": a, "b": b, "c": a + 0.05 * own if twins else a + b + 0.8 * own}
        self.acting = {name: here(name) for name in along}
        self.along = {acting: along[name] for name, acting in self.acting.items()}
        self.y = 1.5 * (a + b if twins else along["c"]) + random.standard_normal(ROWS)
        self.forward = SimpleNamespace(nuisances=[None] * NUISANCES)
        self.settings = Settings()
        self.condition, self.train = np.full(ROWS, "rest"), np.ones(ROWS, bool)


def test_after_a_replacement_the_effect_that_is_no_longer_needed_goes():
    problem = Linear()
    everything = {name: Candidate(*acting, PRIOR) for name, acting in problem.acting.items()}
    for candidate in everything.values():
        candidate.z_score, candidate.guess = 10.0, np.ones(1)
    rounds = [Round([], {}, everything[name], [everything[name]], list(everything.values())) for name in "ab"]
    acting = assume(*(problem.acting[name] for name in "ab"))
    fit = problem.calibrate(acting)

    acting, fit = look_back(problem, acting, fit, rounds)
    assert [effect.name for effect, _ in acting] == ["b", "c"]
    assert [entry.accepted.effect.name for entry in rounds] == ["c", "b"]
    replaced = rounds[0]
    assert replaced.accepted is replaced.shortlist[0] and replaced.shortlist[1].effect.name == "a"
    assert replaced.accepted.probability > 0.99
    assert sum(one.probability for one in replaced.shortlist) + replaced.probabilities["none"] == pytest.approx(1.0)

    acting, fit = look_back(problem, acting, fit, rounds)
    assert [effect.name for effect, _ in acting] == ["c"]
    assert rounds[0].accepted.placed == acting.effects[0] and rounds[1].accepted is None
    assert len(fit.z) == NUISANCES + 1


def test_what_cannot_be_told_from_a_kept_effect_is_judged_beside_the_later_ones():
    problem = Linear(twins=True)
    everything = {name: Candidate(*acting, PRIOR) for name, acting in problem.acting.items()}
    for candidate in everything.values():
        candidate.z_score, candidate.guess = 10.0, np.ones(1)
    rounds = [Round([], {}, everything[name], [everything[name]], list(everything.values())) for name in "ab"]
    acting = assume(*(problem.acting[name] for name in "ab"))
    assert look_back(problem, acting, problem.calibrate(acting), rounds)[0] == acting
    first = rounds[0]
    assert [one.effect.name for one in first.members] == ["a", "c"]
    assert first.beside == assume(problem.acting["b"])
    for one in first.members:
        assert one.fit.z == pytest.approx(problem.calibrate(assume(*first.beside, one.placed)).z)


class Copies(Linear):
    """Effects a and b were hidden; many more are next to a."""

    def __init__(self, copies: int):
        super().__init__(twins=True)
        noise = generator(5, "test", "look back").standard_normal((copies, ROWS))
        for number in range(copies):
            self.acting[f"copy {number}"] = copy = here(f"copy {number}")
            self.along[copy] = self.along[self.acting["a"]] + 0.01 * noise[number]


def test_a_class_holds_all_that_cannot_be_told_from_its_first_beside_the_later_effects():
    """More than are fitted in full, and than the round that named it knew of."""
    problem = Copies(RIVALS + 4)
    everything = {name: Candidate(*acting, PRIOR) for name, acting in problem.acting.items()}
    for candidate in everything.values():
        candidate.z_score, candidate.guess = 10.0, np.ones(1)
    rounds = [Round([], {}, everything[name], [everything[name]], list(everything.values())) for name in "ab"]
    acting = assume(*(problem.acting[name] for name in "ab"))
    look_back(problem, acting, problem.calibrate(acting), rounds)
    assert {one.effect.name for one in rounds[0].members} == set(problem.acting) - {"b"}


def test_a_round_whose_company_was_replaced_looks_at_all_its_candidates_again():
    """What was unlikely beside an effect that is no longer there may be what is missing now."""
    problem = Copies(0)
    right = here("d")
    problem.acting["d"] = right
    problem.along[right] = problem.along[problem.acting["b"]] + generator(6, "test", "look back").standard_normal(ROWS)
    problem.y = 1.5 * (problem.along[problem.acting["c"]] + problem.along[right]) + problem.y * 0.1
    everything = {name: Candidate(*acting, PRIOR, guess=np.ones(1)) for name, acting in problem.acting.items()}
    acting = assume(*(problem.acting[name] for name in "bc"))
    for company, expected in (("c", ["b", "c"]), ("a", ["c", "d"])):
        rounds = [Round([], {}, everything[name], [everything[name]], list(everything.values())) for name in "bc"]
        rounds[0].beside = assume(problem.acting[company])
        for candidate in everything.values():
            candidate.z_score = 0.0
        kept, _ = look_back(problem, acting, problem.calibrate(acting), rounds)
        assert [effect.name for effect, _ in kept] == expected
