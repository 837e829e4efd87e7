"""Readings of one pullback share errors: a hundred of them are not a hundred independent pressures."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.inference.pullback_errors import independent_sd, pullback_errors
from support.pullbacks import pulled_through


def covariance(series):
    """Covariance of the errors of a pullback, mmHg squared."""
    _, shapes = pullback_errors([series])
    return (np.diag(independent_sd(series) ** 2) + shapes.T @ shapes) / MMHG**2


@given(st.floats(0.02, 0.5), st.integers(3, 60))
def test_the_covariance_is_that_of_correlated_noise_and_drift(spacing, count):
    """To within the spread of the variances that the white part replaces (`SMOOTH`)."""
    series = pulled_through("lad", distance=spacing * np.arange(count), length=100.0)
    x, weight = series.pullback.distance, series.pullback.response / MMHG
    expected = np.exp(-np.abs(np.subtract.outer(x, x)) / 0.5) + np.outer(weight, weight)
    found = covariance(series)
    assert np.trace(found) == pytest.approx(np.trace(expected))
    white = float(independent_sd(series)[0] / MMHG) ** 2
    assert np.abs(np.linalg.eigvalsh(found - expected)).max() <= 0.05 * white + 1e-9


def test_more_readings_of_the_same_path_tell_little_more():
    """Standard error of a common pressure (mmHg) from ten and from a hundred readings over 5 cm."""
    errors = {}
    for count in (10, 100):
        series = pulled_through("lad", distance=np.linspace(0.0, 5.0, count), length=5.0)
        ones = np.ones(count)
        errors[count] = float(1.0 / np.sqrt(ones @ np.linalg.solve(covariance(series), ones)))
    # The drift alone leaves at least its value where it is smallest; the noise over ten correlation lengths 0.4 mmHg.
    assert 0.5 < errors[100] < errors[10] < 1.15 * errors[100]
    assert errors[100] > 5.0 / np.sqrt(100)


def test_each_pullback_has_its_own_drift_and_its_check_shares_it():
    first, second = pulled_through("lad"), pulled_through("lcx")
    weights, shapes = pullback_errors([first, second])
    drifts = [shapes[one.shape] for one in weights if one.name.startswith("drift")]
    assert len(drifts) == 2 and not (drifts[0][3:].any() or drifts[1][:3].any())
    assert all(one.noise for one in weights) and [one.shape for one in weights] == list(range(len(weights)))


def test_without_a_pullback_there_is_nothing():
    weights, shapes = pullback_errors([])
    assert weights == [] and shapes.shape == (0, 0)
