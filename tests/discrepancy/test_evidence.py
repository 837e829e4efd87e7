"""Evidence of the likeliest candidates where no test sees anything; candidates weighed with their own time steps."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.problem import MISSED
from coronaryuq.discrepancy.selection.backward_step import _compete_again
from coronaryuq.discrepancy.selection.candidates import CONTENDER, PRIOR_NAMED, Candidate
from coronaryuq.discrepancy.selection.forward_step import Round, name_one
from coronaryuq.discrepancy.selection.refit import LIKELIEST
from coronaryuq.discrepancy.selection.search import _chance_of_evidence, recalibrate
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here

ROWS, NUISANCES, EFFECTS, TRIALS = 60, 3, 12, 4000


class Many(LinearProblem):
    """Twelve effects; data are drawn from the model without any, or with the first at so many standard deviations."""

    def __init__(self):
        random = generator(3, "test", "evidence")
        self.nuisance = random.standard_normal((ROWS, NUISANCES))
        self.effects = [here(f"effect {number}") for number in range(EFFECTS)]
        self.along = {acting: 2.0 * random.standard_normal(ROWS) for acting in self.effects}
        self.forward, self.settings = SimpleNamespace(nuisances=[None] * NUISANCES), Settings()

    def draw(self, random, size=0.0):
        spread = random.standard_normal(NUISANCES)
        hidden = size * self.along[self.effects[0]]
        self.y = self.nuisance @ spread + hidden + random.standard_normal(ROWS)

    def chance(self):
        everything = [Candidate(*acting, np.log(PRIOR_NAMED / EFFECTS)) for acting in self.effects]
        for candidate in everything:
            candidate.guess = np.zeros(1)
            candidate.estimate = self.calibrate(assume(candidate.placed)).evidence
        return _chance_of_evidence(self, self.calibrate(assume()), assume(), everything)


def test_evidence_where_nothing_is_missing_is_a_p_value():
    """It may be smaller than p with a probability of p at most, whatever was drawn; and some of it is not 1."""
    problem, random = Many(), generator(4, "test", "evidence")
    found = []
    for _ in range(TRIALS):
        problem.draw(random)
        found.append(problem.chance())
    for level in (0.3, 0.1, 0.03):
        assert np.sum(np.array(found) <= level) <= stats.binom.ppf(0.999, TRIALS, level)
    assert min(found) < 1.0


def test_evidence_for_an_effect_that_is_there_is_overwhelming():
    problem, random = Many(), generator(5, "test", "evidence")
    problem.draw(random, size=0.6)
    assert problem.chance() < 1e-4
    assert LIKELIEST < EFFECTS


class Ringing(LinearProblem):
    """The hidden effect is the right one; coarse steps leave a ringing out of it, and without that a neighbour is as
    near: problems know what steps put wrong about one set of effects at a time."""

    def __init__(self):
        random = generator(6, "test", "evidence")
        self.nuisance = random.standard_normal((ROWS, NUISANCES))
        right, ringing, own = random.standard_normal((3, ROWS))
        self.right, self.neighbour = here("right"), here("neighbour")
        self.along = {self.right: right, self.neighbour: right + 0.5 * ringing + 0.4 * own}
        self.left_out = {self.right: 0.5 * ringing, self.neighbour: np.zeros(ROWS)}
        self.y = 2.0 * (right + 0.5 * ringing) + random.standard_normal(ROWS)
        self.forward, self.settings = SimpleNamespace(nuisances=[None] * NUISANCES), Settings()
        self.condition, self.train = np.full(ROWS, "rest"), np.ones(ROWS, bool)

    def corrected(self, acting, fit):
        if not acting:
            return self, fit
        other, (last,) = copy.copy(self), acting
        other.change = fit.z[-1] * self.left_out[last]
        other.y = self.y - other.change
        return other, other.calibrate(acting)


def test_a_candidate_is_weighed_with_the_time_steps_put_right_about_itself():
    problem = Ringing()
    both = [
        Candidate(*one, -1.0, z_score=9.0, guess=np.ones(1), fit=problem.calibrate(assume(one)))
        for one in (problem.neighbour, problem.right)
    ]
    ahead = both[0].log_weight - both[1].log_weight
    first = Round(sorted(both, key=lambda c: -c.log_weight), {}, both[0], [both[0]], both)
    assert 0.0 < ahead < CONTENDER
    _, hypothesis, fit = _compete_again(problem, problem, first, assume(), both[0].fit)
    assert hypothesis == assume(problem.right) and fit is first.accepted.fit
    assert first.accepted.placed == problem.right and first.accepted.probability > 0.99
    assert [c.placed for c in first.members] == [problem.right]
    assert first.probabilities["none"] < 1e-6


def test_what_is_not_worth_naming_with_its_own_time_steps_is_given_up_again():
    """What was named was the time steps'; other effects of the search stay, whatever a round of it knew of them."""

    class Rung(Ringing):
        """Coarse steps ring like what is in the data, and with them put right the effect is next to it."""

        def __init__(self):
            super().__init__()
            random = generator(8, "test", "evidence")
            basis = np.linalg.qr(random.standard_normal((ROWS, NUISANCES + 3)))[0]
            self.nuisance, (true, ringing, besides) = 3.0 * basis[:, :NUISANCES], 4.0 * basis[:, NUISANCES:].T
            self.ringing, self.other = ringing, here("other")
            self.along = {self.right: true + ringing, self.other: besides}
            self.y = 2.0 * ringing + 2.0 * besides

        def corrected(self, acting, fit):
            other = copy.copy(self)
            other.change = -2.0 * self.ringing if self.right in acting else np.zeros(ROWS)
            other.y = self.y - other.change
            return other, other.calibrate(acting)

    problem = Rung()
    acting = assume(problem.other, problem.right)
    named = Candidate(*problem.right, -1.0, z_score=9.0, guess=np.ones(1), fit=problem.calibrate(acting))
    found = Round([named], {}, named, [named], [named], beside=assume(problem.neighbour, problem.other))
    assert named.log_weight - problem.calibrate(assume(problem.other)).evidence > Settings().least_log_odds
    after, fit = problem.corrected(acting, named.fit)
    plain, kept, without = _compete_again(problem, after, found, assume(problem.other), fit)
    assert kept == assume(problem.other) and found.accepted is None and found.probabilities["none"] > 0.5
    assert plain.change == pytest.approx(0.0) and len(without.z) == NUISANCES + 1


class Drowned(Ringing):
    """The right effect alone, which coarse steps turn aside so far that by them it is not worth naming."""

    def __init__(self):
        random = generator(7, "test", "evidence")
        basis = np.linalg.qr(random.standard_normal((ROWS, NUISANCES + 2)))[0]
        self.nuisance, (right, aside) = 3.0 * basis[:, :NUISANCES], np.sqrt(8.0) * basis[:, NUISANCES:].T
        self.right = here("right")
        self.along, self.left_out = {self.right: right + 1.5 * aside}, {self.right: -1.5 * aside}
        self.y = 3.0 * right
        self.forward, self.settings = SimpleNamespace(nuisances=[None] * NUISANCES), Settings()
        self.condition, self.train = np.full(ROWS, "rest"), np.ones(ROWS, bool)
        self.candidate = Candidate(*self.right, -9.0, z_score=4.0)


def test_an_effect_that_coarse_steps_turn_aside_is_seen_by_its_own():
    """The evidence by its own steps raises the alarm, and is what it is named by."""
    problem = Drowned()
    base, coarse = problem.calibrate(assume()), problem.calibrate(assume(problem.right))
    own, better = problem.corrected([problem.right], coarse)
    assert problem.missed(own.change) > MISSED and better.evidence > coarse.evidence + 3.0
    candidate = problem.candidate
    candidate.guess, candidate.estimate = np.ones(1), coarse.evidence
    seen = min(1.0, np.exp(base.evidence - better.evidence - candidate.log_prior) * PRIOR_NAMED)
    assert _chance_of_evidence(problem, base, assume(), [candidate]) == pytest.approx(seen) and seen < 0.01
    assert coarse.evidence - base.evidence + candidate.log_prior < Settings().least_log_odds
    found = name_one(problem, base, assume(), np.zeros((ROWS, 1)), [candidate], base)
    assert found.accepted is candidate and candidate.fit.evidence == pytest.approx(better.evidence)


def test_recalibration_puts_time_steps_right_where_it_stays_within_the_prior():
    class Rung(LinearProblem):
        def __init__(self, moved):
            self.nuisance, self.along = np.eye(ROWS)[:, :1] * 10.0, {}
            self.y, self.moved = np.eye(ROWS)[0] * 10.0 * moved, np.eye(ROWS)[1]

        def corrected(self, acting, fit):
            other = copy.copy(self)
            other.change = 5.0 * self.moved
            other.y = self.y - other.change
            return other, other.calibrate(acting)

    for moved, puts_right in ((1.0, True), (9.0, False)):
        problem = Rung(moved)
        right, fit = recalibrate(problem)
        assert (right is not problem) == puts_right
        assert fit.z == pytest.approx(right.calibrate(assume()).z)
