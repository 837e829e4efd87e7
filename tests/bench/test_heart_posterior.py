"""The command that compares the latent coordinates of the heart with the full posterior samples that posterior."""

import numpy as np
import pytest

from coronaryuq.calibration.heart_posterior import HeartPosterior, Normal, gauss_newton
from coronaryuq.core.seeds import generator
from support.benchmark_scripts import benchmark_script


class Model:
    """A heart that is a formula of its free parameters."""

    def __init__(self, formula, seen):
        self.formula, self.seen = formula, seen

    def __call__(self, free, steps):
        return self.formula(free)


@pytest.fixture(scope="module")
def command():
    return benchmark_script("heart_posterior")


def test_chains_about_a_wrong_approximation_sample_the_posterior_that_prior_and_errors_state(command):
    draw = generator(1, "problem")
    slopes, prior, noise = draw.normal(size=(4, 3)), Normal(draw.normal(size=3), np.diag([1.0, 0.5, 2.0])), np.eye(4)
    data = draw.normal(size=4)
    exact = gauss_newton(lambda x: x @ slopes.T, prior, data, noise, np.full(3, 0.1))
    wrong = HeartPosterior(Normal(exact.mean + 0.1, 1.4 * exact.covariance), np.zeros((3, 1)), 1.0, {}, 1)

    model = Model(lambda free: np.hstack([free @ slopes.T, free]), ["x", "y", "z"])
    history = command.sample(command.Heart(wrong, model, model, prior, data, noise, 1.0), 200, 300)
    found = history["seen"][:, 20:]
    sd = np.sqrt(np.diag(exact.covariance))
    assert 0.5 < history["accepted"].mean() < 1.0
    np.testing.assert_allclose((found.mean(axis=(0, 1)) - exact.mean) / sd, 0.0, atol=0.05)
    np.testing.assert_allclose(found.std(axis=(0, 1)) / sd, 1.0, atol=0.05)


def test_no_chain_keeps_a_state_without_a_periodic_run(command):
    one, model = Normal(np.zeros(1), np.eye(1)), Model(lambda x: np.hstack([np.where(x > 0.0, np.nan, x), x]), ["x"])
    found = HeartPosterior(one, np.ones((1, 1)), 1.0, {}, 1)
    seen = command.sample(command.Heart(found, model, model, one, np.zeros(1), np.eye(1), 1.0), 100, 60)["seen"]
    assert np.isnan(seen[:, 0]).any() and not (seen > 0.0).any() and np.isfinite(seen[:, -1]).all()


def test_the_jackknife_is_the_standard_error_of_a_mean(command):
    draws = generator(2, "draws").normal(size=(200, 1, 1))
    mean, error = command.with_error(command.moments(draws)[:, 0])
    assert mean == pytest.approx(draws.mean())
    assert error == pytest.approx(draws.std(ddof=1) / np.sqrt(200), rel=1e-9)
