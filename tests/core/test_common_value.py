"""One value common to several data sets: against all data together, and the p-value of equal values."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.common_value import common_value


def alone(slope, y):
    """Log evidence, mean and variance of a value s by data y = slope s + noise, both standard normal."""
    precision = 1.0 + slope @ slope
    mean = (slope @ y) / precision
    evidence = -0.5 * (y @ y - mean**2 * precision) - 0.5 * np.log(precision)
    return float(evidence), np.array([mean]), np.array([[1.0 / precision]])


@given(st.integers(0, 10_000), st.integers(2, 4))
def test_it_has_the_evidence_and_the_moments_of_all_data_together(seed, count):
    random = np.random.default_rng(seed)
    data = [(random.normal(0, 2, 5), random.normal(0, 2, 5)) for _ in range(count)]
    evidences, means, covariances = zip(*(alone(*one) for one in data), strict=True)
    found = common_value(means, covariances)
    evidence, mean, covariance = alone(*(np.concatenate(parts) for parts in zip(*data, strict=True)))
    assert sum(evidences) + found.log_overlap == pytest.approx(evidence)
    assert found.mean == pytest.approx(mean) and found.covariance == pytest.approx(covariance)


def test_the_p_value_is_uniform_where_values_are_equal():
    """Kolmogorov-Smirnov distance of 400 p-values, at its 0.1 % point."""
    random, p = np.random.default_rng(3), []
    for _ in range(400):
        slopes, size = random.normal(0, 2, (3, 5)), random.normal()
        _, means, covariances = zip(*(alone(one, one * size + random.normal(size=5)) for one in slopes), strict=True)
        p.append(common_value(means, covariances).agreement)
    steps = np.arange(1, 401) / 400
    assert np.max(np.abs(np.sort(p) - steps)) < 1.95 / np.sqrt(400)
