"""Refits: fits that ended worse than without the effect are made again, from other starting points."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Candidate
from coronaryuq.discrepancy.selection.refit import diverged, fit_shortlist, from_other_starts, without_each
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here, linear_problem
from support.two_valleys import two_valleys

ROWS, PRIOR = 120, -3.0
RIGHT, WRONG = here("right"), here("wrong")


class Diverging(LinearProblem):
    """The first effect is the hidden one, but its fit from its own guess ends far away."""

    def far(self, hypothesis):
        exact = self._exact(hypothesis)
        if RIGHT not in hypothesis:
            return exact
        z = np.append(np.zeros(len(exact.z) - 1), -4.0)
        return Fit(z, self.y - exact.jacobian @ z, exact.jacobian)

    def fit_candidates(self, base, hypothesis, candidates, guesses):
        return [self.far(hypothesis.with_(placed)) for placed in candidates]

    def calibrate_each(self, wanted):
        return [self.far(hypothesis) for hypothesis, _ in wanted]

    def multistart_each(self, hypotheses):
        return [self._exact(hypothesis) for hypothesis in hypotheses]


@pytest.fixture
def problem():
    random = generator(9, "test", "astray")
    nuisance = random.standard_normal((ROWS, 2))
    right, own = random.standard_normal((2, ROWS))
    y = 2.0 * right + random.standard_normal(ROWS)
    return linear_problem(nuisance, {RIGHT: right, WRONG: 0.4 * right + own}, y, kind=Diverging)


def test_a_fit_worse_than_without_the_effect_has_diverged(problem):
    base = problem.calibrate(PLAIN)
    fits = [problem.far(assume(RIGHT)), base, None]
    right, kept, unfitted = (Candidate(here(str(i)), PRIOR, estimate=1e3, fit=fit) for i, fit in enumerate(fits))
    assert right.fit.evidence < base.evidence - RULE.diverged_gap
    assert diverged([right, kept, unfitted], 0.0, base.evidence) == [right]
    assert diverged([right], 1e6, base.evidence) == [], "what does not promise to compete is left"


def test_the_best_place_of_the_most_promising_diverged_effects_is_fitted_again(problem):
    base, far = problem.calibrate(PLAIN), problem.far(assume(RIGHT))
    effects = [here(str(number)).effect for number in range(RULE.diverged_refits + 3)]
    candidates = [
        Candidate(PlacedEffect(effect, place), PRIOR, estimate=1e3 + 10.0 * number + better, fit=far)
        for number, effect in enumerate(effects)
        for place, better in (("there", 0.0), ("here", 1.0))
    ]
    again = diverged(candidates, 0.0, base.evidence)
    assert [c.place for c in again] == ["here"] * RULE.diverged_refits
    assert [c.effect for c in again] == effects[: -RULE.diverged_refits - 1 : -1]


def test_the_right_effect_leads_although_its_first_fit_diverged(problem):
    base = problem.calibrate(PLAIN)
    candidates = [Candidate(placed, PRIOR, estimate=base.evidence + 100.0, guess=1.0) for placed in (RIGHT, WRONG)]
    right, wrong = fit_shortlist(problem, base, PLAIN, candidates, base)
    assert right.fit.evidence == pytest.approx(problem.multistart_each([assume(RIGHT)])[0].evidence)
    assert right.log_weight > wrong.log_weight


def test_the_better_of_two_fits_is_kept_and_other_starts_are_tried_once():
    runs = []

    class Counting(Problem):
        def multistart_each(self, hypotheses):
            runs.extend(hypotheses)
            return super().multistart_each(hypotheses)

    problem, placed = two_valleys(Counting)
    better = problem.calibrate(assume(placed), np.array([1.0, 2.0]))
    candidate = Candidate(placed, -1.0, fit=better)
    for _ in range(2):
        (candidate,) = from_other_starts(problem, PLAIN, [candidate])
        assert candidate.fit.evidence >= better.evidence
        assert candidate.fit.z == pytest.approx(better.z, abs=0.05)
        assert runs == [assume(placed)]


def test_candidates_for_a_further_effect_start_near_the_effects_found():
    """Other starting points would put the sizes of the effects found at one of three values."""
    asked = []

    class Distorted(Diverging):
        def distorted(self, fit):
            return True

        def far(self, hypothesis):
            return self._exact(hypothesis)

        def multistart_each(self, hypotheses):
            asked.extend(hypotheses)
            return [None] * len(hypotheses)

    random = generator(9, "test", "further")
    right, own = random.standard_normal((2, ROWS))
    y = 2.0 * right + own + random.standard_normal(ROWS)
    responses = {RIGHT: right, WRONG: own}
    problem = linear_problem(random.standard_normal((ROWS, 2)), responses, y, kind=Distorted)
    for found, asked_for in ((PLAIN, [assume(WRONG)]), (assume(RIGHT), [])):
        asked.clear()
        base = problem.calibrate(found)
        fit_shortlist(problem, base, found, [Candidate(WRONG, PRIOR, estimate=1e3)], base)
        assert asked == asked_for


def test_a_candidate_is_fitted_from_the_point_where_it_looks_better():
    starts = {}

    class Recording(LinearProblem):
        def fit_candidates(self, base, hypothesis, candidates, guesses):
            starts.update(dict.fromkeys(candidates, base))
            return [self._exact(hypothesis.with_(placed)) for placed in candidates]

    random = generator(9, "test", "points")
    right, own = random.standard_normal((2, ROWS))
    problem = linear_problem(random.standard_normal((ROWS, 2)), {RIGHT: right, WRONG: own}, right, kind=Recording)
    base = problem.calibrate(PLAIN)
    point = Fit(np.zeros(2), base.residual, base.jacobian, flexible=base.flexible)
    candidates = [Candidate(placed, PRIOR) for placed in (RIGHT, WRONG)]
    found = fit_shortlist(problem, base, PLAIN, candidates, point, {WRONG})
    assert starts == {RIGHT: base, WRONG: point}
    assert [c.placed for c in found] == [RIGHT, WRONG] and all(c.fit is not None for c in found)


@pytest.mark.parametrize("better", [True, False])
def test_the_model_without_an_effect_is_fitted_from_the_fit_with_it_too(better):
    """From the prior's mean it may end in a worse optimum, which would flatter the effect, or in a better one."""
    random = generator(5, "test", "without")
    design, response = random.standard_normal((40, 2)), random.standard_normal(40)
    problem = linear_problem(design, {RIGHT: response}, random.standard_normal(40))
    fit, exact = problem.calibrate(assume(RIGHT)), problem.calibrate(PLAIN)
    worse = Fit(exact.z + 1.0, exact.residual - design @ np.ones(2), design, flexible=problem.flexible)

    def calibrated(wanted):
        assert [start is None for _, start in wanted] == [True, False]
        assert wanted[1][1] == pytest.approx(fit.z[:2])
        return [worse, exact] if better else [exact, None]

    problem.calibrate_each = calibrated
    (found,) = without_each(problem, assume(RIGHT), fit, [RIGHT])
    assert found is exact
