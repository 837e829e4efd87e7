"""Forward step: the class of the best candidate is fitted whole, and candidates are seen from a distorted fit too."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.candidates import Candidate, indistinguishable
from coronaryuq.discrepancy.selection.forward_step import forward_step
from coronaryuq.discrepancy.selection.refit import fit_class, point_without
from coronaryuq.discrepancy.selection.score_test import screen
from support.hypotheses import assume
from support.linear_problem import here, linear_problem, made_up

ROWS, PRIOR = 150, -4.0


def test_all_segments_that_look_as_good_are_fitted_and_the_best_in_full():
    """A loss in one segment of a vessel looks nearly the same in all; the hidden one is the last."""
    random, segments, loss = generator(9, "test", "alike"), RULE.rivals + 3, made_up("loss")
    nuisance, along = random.standard_normal((ROWS, 3)), random.standard_normal(ROWS)
    places = [PlacedEffect(loss, f"segment {k}") for k in range(segments)]
    responses = {placed: along + 0.05 * random.standard_normal(ROWS) for placed in places}
    responses[PlacedEffect(loss, "elsewhere")] = random.standard_normal(ROWS)
    y = 1.5 * responses[places[-1]] + 0.3 * random.standard_normal(ROWS)
    problem = linear_problem(nuisance, responses, y)

    def exact(placed):
        return problem.calibrate(assume(placed))

    candidates = {placed: Candidate(placed, PRIOR) for placed in responses}
    best = candidates[places[0]] = replace(candidates[places[0]], fit=exact(places[0]))
    near = [replace(c, fit=None, guess=1.0, estimate=best.fit.evidence) for c in candidates.values()]
    near[-1] = replace(near[-1], estimate=best.fit.evidence - 2 * (RULE.class_odds + RULE.class_margin))
    fitted = fit_class(problem, PLAIN, near[1:], point_without(best), best)
    assert [candidate.placed for candidate in fitted] == places[1:]
    for candidate in fitted:
        assert candidate.fit.evidence == pytest.approx(exact(candidate.placed).evidence, abs=0.1)
    best = max(fitted, key=lambda candidate: candidate.log_weight)
    assert places[-1] in [c.placed for c in indistinguishable(best, fitted)] and best.placed != places[0]
    assert best.fit.z == pytest.approx(exact(best.placed).z, abs=1e-9)


RIGHT = here("right")


def accepted(problem, fit, hypothesis, point):
    """The candidate that a step accepts, scored about the fit as in a search."""
    candidates = screen(problem, fit, hypothesis, [Candidate(RIGHT, -3.0)])
    return forward_step(problem, fit, hypothesis, candidates, point, problem.settings.min_log_odds).accepted


def hidden(own, rows=120):
    """A problem, its nuisance parameter's response, and that of what is missing, which has no trace in the data.

    own: size of the nuisance parameter, in whose response the missing one is contained.
    """
    random = generator(11, "test", "astray")
    response, beds = random.standard_normal(rows), random.standard_normal(rows)
    beds -= response * (beds @ response + 2.0 / own * response @ response) / (response @ response)
    y = 2.0 * response + own * beds + random.standard_normal(rows)
    return linear_problem(beds[:, None], {RIGHT: response}, y), response


def test_an_effect_without_a_trace_at_the_priors_mean_is_seen_from_the_distorted_fit():
    """Recalibration is far from its prior, about whose mean the data do not show what is missing."""
    problem, _ = hidden(own=40.0)
    fit = problem.calibrate(PLAIN)
    mean = Fit(np.zeros(1), problem.y, np.zeros((len(problem.y), 1)), flexible=fit.flexible)
    assert accepted(problem, mean, PLAIN, mean) is None
    assert accepted(problem, fit, PLAIN, mean).placed == RIGHT


def test_an_effect_that_distorted_parameters_explain_is_seen_at_the_priors_mean():
    problem, response = hidden(own=1.0)
    mean = problem.calibrate(PLAIN)
    jacobian = response[:, None]
    absorbed = Fit(mean.z, problem.y, jacobian, flexible=mean.flexible)
    assert accepted(problem, absorbed, PLAIN, absorbed) is None
    assert accepted(problem, absorbed, PLAIN, mean).placed == RIGHT
