"""What the data cannot distinguish, and which of it is preferred."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.candidates import (
    Candidate,
    Round,
    class_log_weight,
    indistinguishable,
    preferred,
    shortlist,
)
from support.linear_problem import here


def candidate(evidence: float, log_prior: float = 0.0, nameable: bool = True) -> Candidate:
    fit = Fit(np.zeros(0), np.array([np.sqrt(-2.0 * evidence)]), np.zeros((1, 0)))
    return Candidate(here("made up", nameable=nameable), log_prior, fit=fit)


def test_a_class_holds_candidates_with_odds_or_a_bayes_factor_below_twenty():
    """One effect at two places and its equal at forty: odds of 20 to 1, but no datum distinguishes them."""
    best, equal = candidate(-10.0, np.log(1 / 2)), candidate(-10.0, np.log(1 / 40.1))
    probable, worse = candidate(-14.0, 1.0), candidate(-14.0, np.log(1 / 2))
    assert indistinguishable(best, [worse, equal, probable, best]) == [best, probable, equal]


def test_an_effect_is_preferred_to_a_model_error_in_the_same_class():
    error, close, far = candidate(-10.0, nameable=False), candidate(-12.0), candidate(-15.0)
    assert preferred([far, error, close]) is close
    assert preferred([far, error]) is error


def test_places_that_share_the_prior_of_one_have_its_odds_together():
    """Whether they are named does not depend on how finely a vessel is divided."""
    alone = candidate(-10.0)
    for count in (2, 3, 40):
        places = [candidate(-10.0, -np.log(count)) for _ in range(count)]
        assert class_log_weight(places[0], places) == pytest.approx(class_log_weight(alone, [alone]))
        named = Round(places, places[0], places)
        assert named.class_log_prior == pytest.approx(0.0, abs=1e-12)


def test_distinguishable_candidates_and_model_errors_add_nothing_to_a_class():
    best, far, error = candidate(-10.0), candidate(-14.0), candidate(-10.0, nameable=False)
    assert class_log_weight(best, [best, far, error]) == best.log_weight
    assert class_log_weight(error, [best, far, error]) == error.log_weight


def test_the_clearest_score_tests_are_shortlisted_however_little_they_promise():
    """About a distorted fit, the linear estimate of a strong effect may be below those of its rivals."""
    several = [replace(candidate(0.0), placed=here(f"effect {k}"), z_score=2.0, estimate=-float(k)) for k in range(20)]
    clear = replace(several[-1], z_score=2.9)
    assert [c.placed for c in shortlist([*several[:-1], clear], 4)][-1] == clear.placed


def test_a_candidate_without_a_fit_has_no_weight():
    unfitted = Candidate(here("made up"), 0.0)
    assert unfitted.log_weight == -np.inf
    with pytest.raises(ValueError, match="made up at here was not fitted"):
        _ = unfitted.fitted


def test_beside_effects_found_a_clear_score_alone_shortlists_no_candidate():
    """Where the truth is none of the library, every effect has one; only those that may still win stay."""
    present = Fit(np.zeros(1), np.array([np.sqrt(2.0 * 650.0)]), np.zeros((1, 1)))
    estimates = [-620.0, -630.0, -640.0, -900.0]
    candidates = [
        Candidate(here(str(number)), -5.0, z_score=9.0, estimate=estimate) for number, estimate in enumerate(estimates)
    ]
    assert shortlist(candidates, 1) == candidates, "of a first effect, estimates err too much"
    assert shortlist(candidates, 1, present) == candidates[:3]
    assert shortlist([replace(c, z_score=1.0) for c in candidates], 4, present) == []
    assert shortlist([], 4, present) == []
