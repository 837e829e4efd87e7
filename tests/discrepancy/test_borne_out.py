"""Each of several effects has to stand the test of measurements that no fit had seen by itself."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.cross_validation import folds
from coronaryuq.discrepancy.selection.candidates import Candidate
from coronaryuq.discrepancy.selection.forward_step import Round
from coronaryuq.discrepancy.selection.held_out_check import borne_out
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.base import Parameter
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here

ROWS, NUISANCES, PRIOR = 120, 2, -5.0
SIZE = Parameter("size", "1", "normal", 0.0, 1.0, "")
FITTED = np.arange(ROWS) < 80


class Linear(LinearProblem):
    """Effects "first" and "later", each with unit size and these traces (noise sd) under the two conditions.

    Under the second one, data may have another size of the later effect than under the first, whose it is.
    """

    def __init__(self, random, fitted, kept_out, size_there=1.0, held_out=True):
        self.nuisance = random.standard_normal((ROWS, NUISANCES))
        first, later = random.standard_normal((2, ROWS)), random.standard_normal(ROWS)
        first = first[0] * 2.0
        for rows, trace in ((FITTED, fitted), (~FITTED, kept_out)):
            later[rows] *= trace / np.linalg.norm(later[rows])
        self.acting = assume(*(here(name) for name in ("first", "later")))
        self.along = {"first": first, "later": later}
        size = np.where(FITTED, 1.0, size_there)
        self.y = first + later * size + random.standard_normal(ROWS)
        self.train = FITTED if held_out else np.ones(ROWS, bool)
        self.sd, self.owner = np.ones(ROWS), (~FITTED).astype(int)
        self.condition = np.where(FITTED, "rest", "half dilated")
        conditions = {
            name: SimpleNamespace(held_out=held_out and name != "rest", anchored=False)
            for name in ("rest", "half dilated")
        }
        measured = [SimpleNamespace(quantity="flow", statistic="waveform") for _ in conditions]
        self.forward = SimpleNamespace(conditions=conditions, measured=measured)
        self.settings = Settings()

    def columns(self, acting):
        return np.column_stack([self.nuisance, *(self.along[effect.name] for effect, _ in acting)])

    def calibrate(self, acting, start=None):
        every = self.y, self.nuisance, self.along
        mine = self.train
        self.y, self.nuisance = self.y[mine], self.nuisance[mine]
        self.along = {name: along[mine] for name, along in self.along.items()}
        try:
            return super().calibrate(acting, start)
        finally:
            self.y, self.nuisance, self.along = every

    def whitened(self, rows):
        return self.fitted(rows)

    def sensitivity(self, z, residual, acting):
        return self.columns(acting)


def answer(problem, still=False):
    """Names that stand, and their rounds by name."""
    fit = problem.calibrate(problem.acting)
    entries = {}
    for one in problem.acting:
        candidate = Candidate(*one, PRIOR)
        candidate.fit = fit
        entries[one[0].name] = Round([], {}, candidate, [candidate])
    parts = folds(problem, [name for name, c in problem.forward.conditions.items() if c.held_out])
    acting, found = borne_out(problem, problem.acting, fit, list(entries.values()), still, parts, 1)
    assert len(found.z) == NUISANCES + len(acting)
    return [effect.name for effect, _ in acting], entries


def random(number):
    return generator(5, "test", "borne out", number)


@pytest.mark.parametrize("held_out", [True, False])
@pytest.mark.parametrize("still", [True, False])
def test_effects_that_hold_stay_and_say_what_they_add(held_out, still):
    names, entries = answer(Linear(random(0), 10.0, 8.0, held_out=held_out), still)
    assert names == ["first", "later"]
    assert all(entry.worth > 5.0 and entry.held_out > 5.0 for entry in entries.values())
    assert entries["later"].worth < entries["first"].worth


def test_what_held_out_measurements_outweigh_is_taken_back():
    """A trace of 6, 18 nats less Occam's share, against 8 noise sd of it where there is none."""
    names, entries = answer(Linear(random(1), 6.0, 8.0, size_there=0.0))
    later = entries["later"]
    assert names == ["first"]
    assert later.accepted is None and later.taken_back.effect.name == "later"
    assert entries["first"].held_out is None and np.isinf(entries["first"].worth)


@pytest.mark.parametrize(("still", "stays"), [(False, True), (True, False)])
def test_evidence_of_a_fit_that_leaves_something_outweighs_nothing(still, stays):
    """A trace of 30 here, and of another sign there: all together ask for it, those kept out do without it."""
    names, entries = answer(Linear(random(2), 30.0, 6.0, size_there=-0.5), still)
    assert ("later" in names) == stays
    if stays:
        assert entries["later"].worth > 100.0 and entries["later"].held_out < -3.0


def test_data_left_out_in_turn_are_counted_once():
    """No evidence of their own; but where something remains an effect has to help them."""
    problem = Linear(random(3), 6.0, 8.0, size_there=-0.6, held_out=False)
    assert "later" in answer(problem)[0]
    assert "later" not in answer(problem, still=True)[0]


@pytest.mark.parametrize("still", [True, False])
def test_weak_effects_that_are_there_are_seldom_taken_back(still):
    """Traces of 6 and, kept out, 4: in 300 trials in no more than 3 % of them, four standard errors allowed."""
    trials, level = 300, 0.03
    lost = sum("later" not in answer(Linear(random(number), 6.0, 4.0), still)[0] for number in range(trials))
    assert lost / trials < level + 4.0 * np.sqrt(level * (1.0 - level) / trials)
