"""Every place that the data may not tell from the best one is fitted before a class is declared."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.selection.candidates import Candidate, indistinguishable
from coronaryuq.discrepancy.selection.forward_step import fit_alike
from coronaryuq.discrepancy.selection.refit import ALIKE, RIVALS
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume, placed
from support.linear_problem import LinearProblem, made_up

ROWS, NUISANCES, SEGMENTS, PRIOR = 150, 3, RIVALS + 3, -4.0
LOSS = made_up("loss")


class Segments(LinearProblem):
    """A linear problem: a loss in one segment of a vessel looks nearly the same in all; the hidden one is the last."""

    def __init__(self):
        random = generator(9, "test", "alike")
        self.nuisance, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS)
        places = [placed(LOSS, f"segment {k}") for k in range(SEGMENTS)]
        self.along = {acting: along + 0.05 * random.standard_normal(ROWS) for acting in places}
        self.along[placed(LOSS, "elsewhere")] = random.standard_normal(ROWS)
        self.y = 1.5 * self.along[places[-1]] + 0.3 * random.standard_normal(ROWS)
        self.settings = Settings()
        self.everything = [Candidate(*acting, PRIOR) for acting in self.along]


def test_all_segments_that_look_as_good_are_fitted_and_the_best_in_full():
    problem = Segments()
    best, hidden = problem.everything[0], problem.everything[SEGMENTS - 1]
    best.fit = problem.calibrate(assume(best.placed))
    chosen, guess = [best], np.ones(1)
    near = [replace(c, fit=None, guess=guess, estimate=best.fit.evidence) for c in problem.everything]
    near[-1].estimate = best.fit.evidence - 2 * ALIKE
    fit_alike(problem, best, assume(), chosen, near, problem.everything)
    assert {c.place for c in chosen} == {f"segment {k}" for k in range(SEGMENTS)}
    for candidate in chosen:
        assert candidate.fit.evidence == pytest.approx(problem.calibrate(assume(candidate.placed)).evidence, abs=0.1)
    ahead = max(chosen, key=lambda c: c.log_weight)
    assert hidden in indistinguishable(ahead, chosen)
    assert ahead.fit.z == pytest.approx(problem.calibrate(assume(ahead.placed)).z, abs=1e-9)
