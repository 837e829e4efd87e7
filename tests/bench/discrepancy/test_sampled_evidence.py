"""Evidence by importance sampling: integrals that are known, and their stated errors."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.sampled_evidence import integrate

TRIALS = 60
CONSTANT = 3.0


def bent(x: np.ndarray) -> np.ndarray:
    """Log density of a normal distribution bent along a parabola, of mass exp(`CONSTANT`)."""
    straight = np.stack([x[:, 0], x[:, 1] - 0.3 * (x[:, 0] ** 2 - 1.0)], axis=1)
    return CONSTANT - 0.5 * np.sum(straight**2, axis=1) - np.log(2.0 * np.pi)


def two_modes(x: np.ndarray) -> np.ndarray:
    """Log density of two normal distributions four standard deviations apart, of mass exp(`CONSTANT`)."""
    each = [-0.5 * np.sum((x - [centre, 0.0]) ** 2, axis=1) for centre in (-2.0, 2.0)]
    return CONSTANT + np.logaddexp(*each) - np.log(4.0 * np.pi)


@pytest.mark.parametrize("density", [bent, two_modes])
def test_integrals_are_met_within_their_stated_errors(density):
    found = [integrate(density, np.zeros(2), np.eye(2), np.random.default_rng(k)) for k in range(TRIALS)]
    z = np.array([(one.log_evidence - CONSTANT) / one.error for one in found])
    assert abs(z.mean()) < 4.5 / np.sqrt(TRIALS)
    assert abs(np.mean(z**2) - 1.0) < 4.5 * np.sqrt(2.0 / TRIALS)
    assert np.mean([one.k_hat < 0.7 for one in found]) > 0.9


def test_laplace_is_wrong_where_two_modes_share_the_mass():
    """About one mode it has half of the mass; sampling, begun there, finds both."""
    one = integrate(two_modes, np.array([2.0, 0.0]), np.eye(2), np.random.default_rng(1))
    laplace = CONSTANT - np.log(2.0)
    assert abs(one.log_evidence - CONSTANT) < 4.5 * one.error < abs(laplace - CONSTANT)


def test_a_density_without_mass_where_it_is_sought_has_no_integral():
    found = integrate(lambda x: np.full(len(x), -np.inf), np.zeros(2), np.eye(2), np.random.default_rng(0))
    assert found.log_evidence == -np.inf and np.isnan(found.k_hat)
