"""Forward step: the class of the best candidate is fitted whole, and candidates are seen from a distorted fit too."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.candidates import Candidate, indistinguishable
from coronaryuq.discrepancy.selection.forward_step import Pool, fit_class, forward_step
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
    pool = fit_class(problem, best, PLAIN, Pool(candidates, (best.placed,)), near)
    assert set(pool.chosen) == set(places)
    for candidate in pool.shortlist:
        assert candidate.fit.evidence == pytest.approx(exact(candidate.placed).evidence, abs=0.1)
    assert places[-1] in [c.placed for c in indistinguishable(pool.best, pool.shortlist)]
    assert pool.best.fit.z == pytest.approx(exact(pool.best.placed).z, abs=1e-9)


def test_an_effect_hidden_at_the_priors_mean_is_seen_from_the_distorted_fit():
    """At the prior's mean, beside an effect that is named, what is missing has no visible trace."""
    random, rows = generator(10, "test", "astray"), 120
    nuisance = random.standard_normal((rows, 2))
    named, right = here("named"), here("right")
    responses = {named: random.standard_normal(rows), right: random.standard_normal(rows)}
    y = 2.0 * responses[right] + 40.0 * nuisance[:, 0] + random.standard_normal(rows)
    problem = linear_problem(nuisance, responses, y)
    fit, least = problem.calibrate(assume(named)), problem.settings.min_log_odds
    for point, seen in ((fit, False), (Fit(np.zeros(3), y, fit.jacobian, flexible=fit.flexible), True)):
        step = forward_step(problem, fit, assume(named), [Candidate(right, -3.0, guess=1.0)], point, least)
        assert (step.accepted is not None) is seen


def test_the_first_effect_is_seen_from_the_distorted_fit_too():
    """Beds far from their prior hide an effect at its mean, where the beds' own effect on the data is another."""
    random, rows = generator(11, "test", "astray"), 120
    right = here("right")
    response, beds = random.standard_normal(rows), random.standard_normal(rows)
    beds -= response * (beds @ response + 0.05 * response @ response) / (response @ response)
    y = 2.0 * response + 40.0 * beds + random.standard_normal(rows)
    problem = linear_problem(beds[:, None], {right: response}, y)
    fit, least = problem.calibrate(PLAIN), problem.settings.min_log_odds
    mean = Fit(np.zeros(1), y, np.zeros((rows, 1)), flexible=fit.flexible)
    step = forward_step(problem, fit, PLAIN, [Candidate(right, -3.0)], mean, least)
    assert step.accepted is not None and step.accepted.placed == right
