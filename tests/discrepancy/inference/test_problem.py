"""Fits of a problem: several starts where the objective has several optima."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.gauss_newton import maximise
from coronaryuq.discrepancy.inference.problem import RESTARTS, Problem
from support.hypotheses import assume
from support.linear_problem import here, linear_problem
from support.two_valleys import two_valleys


def test_several_starts_find_the_better_optimum(monkeypatch):
    batches = []

    def recording(evaluate, searches, iterations):
        batches.append([search.z.tolist() for search in searches])
        return maximise(evaluate, searches, iterations)

    problem, placed = two_valleys()
    worse = problem.calibrate(assume(placed), np.array([1.0, -2.0]))
    assert worse.z[1] == pytest.approx(-2.0, abs=0.3)
    monkeypatch.setattr("coronaryuq.discrepancy.inference.problem.maximise", recording)
    better, again = problem.multistart_each([assume(placed)] * 2)
    assert better.z[1] == pytest.approx(2.0, abs=0.3) and better.evidence > worse.evidence
    assert batches[0] == [[0.0, size] for size in RESTARTS] * 2, "all at once"
    assert again.evidence == better.evidence


def test_a_start_that_cannot_compete_even_by_its_linear_model_ends_early(monkeypatch):
    """Of two effects one explains nothing: its fits end after two iterations."""
    random = generator(3, "test", "no chance")
    signal, other = random.standard_normal((2, 60))
    curved = {
        here("right"): lambda z: 20.0 * signal * (z + 0.1 * z**2),
        here("wrong"): lambda z: other * (z + 0.1 * z**2),
    }
    y = 20.0 * signal * 1.9 + random.standard_normal(60)
    problem = linear_problem(np.zeros((60, 1)), curved, y, kind=Problem)
    batches = []

    def recording(evaluate, searches, iterations):
        batches.append([search.label for search in searches])
        return maximise(evaluate, searches, iterations, 1e-9, 0.0)

    monkeypatch.setattr("coronaryuq.discrepancy.inference.problem.maximise", recording)
    right, wrong = problem.multistart_each([assume(placed) for placed in curved])
    assert right.evidence > wrong.evidence + 100.0
    assert set(batches[1]) == {assume(next(iter(curved)))}
