"""The posterior of the tuned heart: exact where the model is linear, calibrated where it bends a little, and small."""

import numpy as np
import pytest
from scipy.stats import chi2

from coronaryuq.calibration import parameters
from coronaryuq.calibration.heart_posterior import (
    SHARE,
    Normal,
    assumed_parameters,
    gauss_newton,
    heart_posterior,
    latent_directions,
    linearised,
)
from coronaryuq.calibration.hyperaemic_flow import hyperaemic_changes
from coronaryuq.calibration.initial_scaling import scaled
from coronaryuq.calibration.loop import Loop
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.network.network import UNCERTAIN, Network
from coronaryuq.core.seeds import generator
from coronaryuq.zerod.theta import Theta
from support.small_loop import loop

DIMENSION, DATA = 4, 6


def random_problem(seed: int):
    draw = generator(seed, "problem")
    slopes = draw.normal(size=(DATA, DIMENSION))
    spread = draw.normal(size=(DIMENSION, DIMENSION))
    prior = Normal(draw.normal(size=DIMENSION), spread @ spread.T + 0.3 * np.eye(DIMENSION))
    return slopes, prior, np.diag(draw.uniform(0.2, 1.0, DATA))


def test_for_a_linear_model_the_posterior_is_the_conjugate_one():
    slopes, prior, noise = random_problem(1)
    data = generator(2, "data").normal(size=DATA)
    found = gauss_newton(lambda x: x @ slopes.T, prior, data, noise, np.full(DIMENSION, 0.1))
    gain = prior.covariance @ slopes.T @ np.linalg.inv(slopes @ prior.covariance @ slopes.T + noise)
    np.testing.assert_allclose(found.mean, prior.mean + gain @ (data - slopes @ prior.mean), atol=1e-9)
    np.testing.assert_allclose(found.covariance, prior.covariance - gain @ slopes @ prior.covariance, atol=1e-9)


@pytest.mark.parametrize("bend", [0.0, 0.05])
def test_simulation_based_calibration_of_a_model_that_bends_a_little(bend):
    """Ranks of the truth among posterior quantiles are uniform, in every direction (Talts et al. 2018)."""
    trials, bins = 400, 10
    slopes, prior, noise = random_problem(3)
    draw = generator(4, "calibration")
    root = np.linalg.cholesky(prior.covariance)

    def model(x):
        return x @ slopes.T + bend * (x @ slopes.T) ** 2

    counts = np.zeros((DIMENSION, bins))
    for _ in range(trials):
        truth = prior.mean + root @ draw.normal(size=DIMENSION)
        data = model(truth[None])[0] + np.sqrt(np.diag(noise)) * draw.normal(size=DATA)
        found = gauss_newton(model, prior, data, noise, np.full(DIMENSION, 1e-3), iterations=6)
        draws = found.mean + draw.normal(size=(199, DIMENSION)) @ np.linalg.cholesky(found.covariance).T
        rank = (draws < truth).sum(axis=0)
        counts[np.arange(DIMENSION), rank * bins // 200] += 1
    expected = trials / bins
    statistic = ((counts - expected) ** 2 / expected).sum(axis=1)
    assert (statistic < chi2.isf(0.001 / DIMENSION, bins - 1)).all(), statistic


def test_latent_directions_carry_the_outputs_covariance_and_are_uncorrelated():
    draw = generator(5, "latent")
    spread = draw.normal(size=(7, 7))
    covariance, seen = spread @ spread.T, draw.normal(size=(2, 7))
    directions, captured = latent_directions(covariance, seen)
    assert directions.shape == (7, 2) and captured == pytest.approx(1.0)
    np.testing.assert_allclose(seen @ directions @ directions.T @ seen.T, seen @ covariance @ seen.T, rtol=1e-9)
    precision = np.linalg.inv(covariance)
    np.testing.assert_allclose(directions.T @ precision @ directions, np.eye(2), atol=1e-9)


def test_many_flows_that_vary_together_do_not_hide_a_pressure():
    """Nineteen flows vary by 25 % as one, a pressure by 5 % for itself: it is 0.2 % of the variance, and counts."""
    draw = generator(6, "hidden")
    seen = np.vstack([np.tile([0.25, 0.0, 0.0], (19, 1)), [[0.0, 0.05, 0.0]]])
    seen[:19, 2] = 0.01 * draw.normal(size=19)
    directions, least = latent_directions(np.eye(3), seen)
    carried = ((seen @ directions) ** 2).sum(axis=1) / (seen**2).sum(axis=1)
    assert carried.min() == pytest.approx(least) and least >= SHARE
    assert directions.shape[1] == 2
    assert (seen @ directions)[19] @ (seen @ directions)[19] == pytest.approx(0.05**2, rel=0.06)


def test_a_side_without_predictions_leaves_the_slope_to_the_other_and_none_leaves_none():
    slopes = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])

    def model(x):
        values = x @ slopes.T
        values[(x[:, 1] > 0.05) | (np.abs(x[:, 2]) > 0.05)] = np.nan
        return values

    _, found = linearised(model, np.zeros(3), np.full(3, 0.1))
    np.testing.assert_allclose(found, slopes * [1.0, 1.0, 0.0])


def test_assumed_values_become_columns_that_leave_the_network_alone_at_their_centre():
    network = loop()
    theta = Theta(Network(network | {UNCERTAIN: assumed_parameters(network, RoutineErrors())}))
    assert theta.laws.names == ["hyperaemia", "viscosity"]
    plain = Theta(network).changes({})
    for name, value in theta.changes({name: np.ones(1) for name in theta.laws.names}).items():
        block, parameter = name.rsplit(".", 1)
        assert value == pytest.approx(
            plain.get(name, network.vessel_values(block)[parameter] if name not in plain else 0)
        )


@pytest.mark.slow
def test_a_loop_that_is_periodic_only_at_finer_time_steps_has_the_posterior_of_these(small_loop, adult):
    network, errors = scaled(small_loop, adult, 1.0), RoutineErrors()
    point, fine, coarse = parameters.INITIAL, Loop(network, 320), Loop(network, 30)
    rest = fine.evaluate(point[None])
    relaxed = hyperaemic_changes(network, point[None], 0.24)
    states = rest.state[0], fine.evaluate(point[None], rest.state, extra=relaxed, refill=False).state[0]
    assert not coarse.evaluate(point[None], rest.state, refill=False).ok.any()
    expected = heart_posterior(Loop(network, 60), point, states, adult, 0.24, errors, 60)
    found = heart_posterior(coarse, point, states, adult, 0.24, errors, 1000)
    np.testing.assert_array_equal(found.directions, expected.directions)
    with pytest.raises(RuntimeError, match="at 30 time steps per cycle"):
        heart_posterior(coarse, point, states, adult, 0.24, errors, 30)
