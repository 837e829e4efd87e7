"""What the data cannot tell apart, and which of it goes first."""

from types import SimpleNamespace

import numpy as np

from coronaryuq.discrepancy.candidates import Candidate, indistinguishable, preferred
from coronaryuq.discrepancy.inference import Fit


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
