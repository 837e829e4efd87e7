"""Fits of a problem: several starts where the objective has several optima."""

import numpy as np
import pytest

from coronaryuq.discrepancy.inference.problem import RESTARTS, Problem
from support.hypotheses import assume
from support.two_valleys import two_valleys


def test_several_starts_find_the_better_optimum():
    starts = []

    class Recording(Problem):
        def calibrate_each(self, wanted):
            starts.extend(start for _, start in wanted)
            return super().calibrate_each(wanted)

    problem, placed = two_valleys(Recording)
    worse = problem.calibrate(assume(placed), np.array([1.0, -2.0]))
    assert worse.z[1] == pytest.approx(-2.0, abs=0.3)
    better = problem.multistart(assume(placed))
    assert better.z[1] == pytest.approx(2.0, abs=0.3) and better.evidence > worse.evidence
    assert [start.tolist() for start in starts[1:]] == [[0.0, size] for size in RESTARTS]
