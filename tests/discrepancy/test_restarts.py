"""A fit that left the prior is made again from other points, and the best of all is kept."""

import numpy as np
import pytest

from coronaryuq.discrepancy.inference import Search, maximise
from coronaryuq.discrepancy.problem import Problem


class TwoValleys:
    """One nuisance parameter z and one size s; the data are explained at s = 2, and less well near s = -2."""

    count = 1

    def __init__(self):
        self.starts = []

    def fitted(self, rows):
        def residual(z, s):
            return [s**2 - 4.0, 0.3 * (s - 2.0) * (s < 0.0), 0.2 * z]

        return np.array([residual(*z) for z, _ in rows])

    def calibrate_each(self, wanted):
        self.starts += [tuple(start) for _, start in wanted]
        # The model cannot be run at a size of nought.
        searches = [Search(acting, np.array(start, dtype=float), [0, 1]) for acting, start in wanted if start[1]]
        maximise(self.fitted, searches, 30)
        found = iter(searches)
        return [next(found).fit if start[1] else None for _, start in wanted]

    def calibrate(self, start):
        return self.calibrate_each([([], np.array(start))])[0]


def test_the_better_valley_is_found_from_the_worse():
    problem = TwoValleys()
    worse = problem.calibrate([1.0, -2.0])
    assert worse.z[1] == pytest.approx(-2.0, abs=0.3)
    better = Problem.restarted(problem, [], worse)
    assert better.z[1] == pytest.approx(2.0, abs=0.3) and better.evidence > worse.evidence
    assert {start[0] for start in problem.starts[1:]} == {0.0}


def test_the_better_valley_is_kept():
    problem = TwoValleys()
    better = problem.calibrate([1.0, 2.0])
    kept = Problem.restarted(problem, [], better)
    assert kept.evidence >= better.evidence and kept.z == pytest.approx(better.z, abs=0.05)
