"""A fit that left the prior is made again from other points, and the best of all is kept."""

import numpy as np
import pytest

from coronaryuq.discrepancy.inference.problem import RESTARTS, Problem
from coronaryuq.discrepancy.selection.candidates import Candidate, refit
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume
from support.linear_problem import here


class TwoValleys:
    """One nuisance parameter z and one size s; the data are explained at s = 2, and less well near s = -2. The model
    cannot be run at a size of nought."""

    count, settings, _in_full = 1, Settings(), Problem._in_full

    def __init__(self):
        self.starts = []

    def fitted(self, rows):
        def residual(z, s):
            return [s**2 - 4.0, 0.3 * (s - 2.0) * (s < 0.0), 0.2 * z if s else np.nan]

        return np.array([residual(*z) for z, _ in rows])

    def linear_part(self):
        return [], np.zeros((3, 0))

    def calibrate_each(self, wanted):
        self.starts += [tuple(start) for _, start in wanted]
        return Problem.calibrate_each(self, wanted)

    def calibrate(self, start):
        return self.calibrate_each([(assume(), np.array(start))])[0]


def test_the_better_valley_is_found_from_the_worse():
    problem = TwoValleys()
    worse = problem.calibrate([1.0, -2.0])
    assert worse.z[1] == pytest.approx(-2.0, abs=0.3)
    better = Problem.from_the_mean(problem, assume(here("made up")))
    assert better.z[1] == pytest.approx(2.0, abs=0.3) and better.evidence > worse.evidence
    assert {start[0] for start in problem.starts[1:]} == {0.0}


def test_the_better_valley_is_kept_and_none_is_looked_for_twice():
    problem = TwoValleys()
    better = problem.calibrate([1.0, 2.0])
    one = Candidate(*here("made up"), -1.0, fit=better)
    problem.from_the_mean = lambda acting: Problem.from_the_mean(problem, acting)
    for runs in (1 + len(RESTARTS), 1 + len(RESTARTS)):
        refit(problem, assume(), [one])
        assert one.fit.evidence >= better.evidence and one.fit.z == pytest.approx(better.z, abs=0.05)
        assert len(problem.starts) == runs
