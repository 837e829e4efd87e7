"""Predictive ranges hold the truth as often as stated although their ends are estimated."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis.predictive import predictive, with_prediction
from coronaryuq.estimation.estimators.beyond_the_mean import SHARES
from coronaryuq.estimation.results import BeyondTheMean, Value
from support.estimates import row

TRIALS = 100_000


def estimated(values, std):
    """Return quantiles with their standard errors."""
    return {
        f"{share:.3f}": Value(float(value), float(error), value - 2 * error, value + 2 * error, 0.95)
        for share, value, error in zip(SHARES, values, np.broadcast_to(std, len(SHARES)), strict=True)
    }


@pytest.mark.parametrize("error", [0.3, 0.6])
def test_ranges_with_estimated_ends_hold_the_truth_as_often_as_stated(error):
    random = generator(1, "predictive")
    quantiles = ndtri(SHARES)
    spread = np.array(list(predictive(estimated(quantiles, error)).values()))
    truth, shift = random.standard_normal(TRIALS), error * random.standard_normal(TRIALS)
    for low, high, stated in ((0, 6, 0.95), (1, 5, 0.90), (2, 4, 0.50)):
        three = 3 * (stated * (1 - stated) / TRIALS) ** 0.5
        inside = np.mean((spread[low] + shift <= truth) & (truth <= spread[high] + shift))
        assert inside == pytest.approx(stated, abs=three)
        bare = np.mean((quantiles[low] + shift <= truth) & (truth <= quantiles[high] + shift))
        assert bare < stated - three, "without the error of its ends a range holds less than it states"


def test_a_normal_law_and_a_normal_error_add_in_squares():
    found = predictive(estimated(3.0 + 2.0 * ndtri(SHARES), 1.5))
    assert list(found.values()) == pytest.approx(3.0 + 2.5 * ndtri(SHARES), abs=0.01)


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7),
    st.lists(st.floats(0.0, 0.5), min_size=7, max_size=7),
)
def test_predictive_quantiles_rise_and_are_those_of_the_states_without_errors(values, errors):
    found = list(predictive(estimated(sorted(values), errors)).values())
    assert np.all(np.diff(found) >= -1e-12)
    exact = list(predictive(estimated(sorted(values), 0.0)).values())
    assert exact == pytest.approx(sorted(values), abs=0.02)


def test_a_row_without_quantiles_has_no_prediction():
    plain = row(beyond_the_mean=BeyondTheMean())
    assert with_prediction(plain) is plain
