"""The fit of losses on linear models whose losses are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.losses.fit import fit_losses


def linear(seed: int, runs: int = 8, places: int = 5, losses: int = 4):
    """A linear model of pressures, and its slopes."""
    random = np.random.default_rng(seed)
    slopes, base = random.normal(size=(runs, places, losses)), random.uniform(0.7, 0.9, (runs, places))
    return lambda z: base + np.einsum("nmp,kp->knm", slopes, z), slopes, random


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_without_noise_losses_are_found(seed):
    model, _, random = linear(seed)
    truth = random.normal(size=4)
    fit = fit_losses(model, model(truth[None])[0], np.full(4, -np.inf))
    assert np.abs(fit.mean - truth).max() < 1e-3
    assert np.abs(fit.after).max() < 1e-3 < np.abs(fit.before).max()


def test_standardised_errors_of_losses_have_unit_variance():
    errors = []
    for seed in range(300):
        model, _, random = linear(seed)
        truth = random.normal(size=4)
        measured = model(truth[None])[0] + 0.3 * random.normal(size=(8, 5))
        fit = fit_losses(model, measured, np.full(4, -np.inf))
        errors.append(np.linalg.solve(np.linalg.cholesky(fit.covariance), fit.mean - truth))
    squares = np.mean(np.square(errors))
    # 1,200 squares with the variance of a chi-square, and of Student's t for an unknown noise.
    assert abs(squares - 1.0) < 4 * np.sqrt(2 / 1200) + 0.1


def test_a_run_that_is_left_out_is_predicted_as_without_it():
    model, slopes, random = linear(3)
    measured = model(random.normal(size=(1, 4)))[0] + 0.1 * random.normal(size=(8, 5))
    fit = fit_losses(model, measured, np.full(4, -np.inf))
    others = np.arange(8) != 2

    def without(z):
        return model(z)[:, others]

    alone = fit_losses(without, measured[others], np.full(4, -np.inf))
    expected = measured[2] - model(alone.mean[None])[0, 2]
    assert fit.left_out[2] == pytest.approx(expected, abs=1e-3)


def test_no_resistance_becomes_negative():
    model, _, _ = linear(5)
    measured = model(np.array([[-3.0, 0.5, 0.0, 1.0]]))[0]
    fit = fit_losses(model, measured, np.array([-1.0, -1.0, -np.inf, -np.inf]))
    assert fit.mean[0] >= -1.0 - 1e-12
