"""What the data cannot tell apart, and which of it goes first."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.candidates import Candidate, indistinguishable, of_class, preferred
from coronaryuq.discrepancy.selection.forward_step import Round


def candidate(evidence: float, log_prior: float = 0.0, nameable: bool = True) -> Candidate:
    found = Candidate(SimpleNamespace(nameable=nameable), "here", log_prior)
    found.fit = Fit(np.zeros(0), np.array([np.sqrt(-2.0 * evidence)]), np.zeros((1, 0)))
    return found


def test_a_class_holds_what_has_odds_or_a_bayes_factor_below_twenty():
    """One at two places and its equal at forty: the odds are 20 to 1, but no datum tells them apart."""
    best, equal = candidate(-10.0, np.log(1 / 2)), candidate(-10.0, np.log(1 / 40.1))
    probable, worse = candidate(-14.0, 1.0), candidate(-14.0, np.log(1 / 2))
    assert indistinguishable(best, [worse, equal, probable, best]) == [best, probable, equal]


def test_an_effect_goes_before_a_mistake_that_the_data_cannot_tell_from_it():
    mistake, close, far = candidate(-10.0, nameable=False), candidate(-12.0), candidate(-15.0)
    assert preferred([far, mistake, close]) is close
    assert preferred([far, mistake]) is mistake


def test_places_that_share_the_prior_of_one_have_its_odds_together():
    """As many places as one likes, all alike: whether they are named does not hang on how finely a vessel is cut."""
    alone = candidate(-10.0)
    for count in (2, 3, 40):
        places = [candidate(-10.0, -np.log(count)) for _ in range(count)]
        assert of_class(places[0], places) == pytest.approx(of_class(alone, [alone]))
        named = Round(places, {}, places[0], places)
        assert named.class_log_prior == pytest.approx(0.0, abs=1e-12)


def test_what_the_data_tell_apart_and_mistakes_add_nothing_to_a_class():
    best, far, mistake = candidate(-10.0), candidate(-14.0), candidate(-10.0, nameable=False)
    assert of_class(best, [best, far, mistake]) == best.log_weight
    assert of_class(mistake, [best, far, mistake]) == mistake.log_weight
