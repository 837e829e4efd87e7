"""Flexible discrepancy: evidence and moments against dense Gaussian algebra, for every amplitude."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.special import logsumexp

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT, UNKNOWN, Flexible, Projection
from coronaryuq.discrepancy.inference.gauss_newton import Fit

ROWS, PARAMETERS = 30, 4


def case(seed, signal=0.0):
    """Sensitivities, features in two blocks, whitened data with so much of a feature, and the blocks of the rows."""
    random = generator(seed, "test", "flexible")
    jacobian = random.standard_normal((ROWS, PARAMETERS))
    blocks = np.repeat([0, 1], ROWS // 2)
    features = np.zeros((ROWS, 6))
    features[blocks == 0, :3] = 40.0 * random.standard_normal((ROWS // 2, 3))
    features[blocks == 1, 3:] = 40.0 * random.standard_normal((ROWS // 2, 3))
    y = jacobian @ random.standard_normal(PARAMETERS) + random.standard_normal(ROWS) + signal * features[:, 0]
    return jacobian, features, blocks, y


def dense(jacobian, features, y, amplitude):
    """Log evidence, mean and covariance of z by matrices (N, N)."""
    noise = np.eye(ROWS) + amplitude**2 * features @ features.T
    density = stats.multivariate_normal(np.zeros(ROWS), noise + jacobian @ jacobian.T).logpdf(y)
    covariance = np.linalg.inv(np.eye(PARAMETERS) + jacobian.T @ np.linalg.solve(noise, jacobian))
    return density, covariance @ jacobian.T @ np.linalg.solve(noise, y), covariance


@given(st.integers(0, 50), st.floats(0.0, 1.0), st.sets(st.integers(0, PARAMETERS - 1)))
def test_it_is_the_exact_gaussian_posterior(seed, signal, shared):
    """Whichever columns of the sensitivities are shapes that all models share."""
    jacobian, features, blocks, y = case(seed, signal)
    columns = sorted(shared)
    posterior = Flexible(features, blocks, (columns, jacobian[:, columns])).posterior(y, jacobian)
    constant = 0.5 * ROWS * np.log(2.0 * np.pi)
    for number, amplitude in enumerate(AMPLITUDES):
        evidence, mean, covariance = dense(jacobian, features, y, amplitude)
        assert posterior.log_evidence[number] == pytest.approx(evidence + constant, rel=1e-8, abs=1e-6)
        np.testing.assert_allclose(posterior.mean[number], mean, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(posterior.covariance[number], covariance, rtol=1e-6, atol=1e-8)


def test_a_model_without_the_shapes_is_refused():
    jacobian, features, blocks, y = case(1)
    with pytest.raises(ValueError, match="shapes"):
        Flexible(features, blocks, ([0], jacobian[:, 1:2])).posterior(y, jacobian)


def test_evidence_averages_the_amplitudes_with_their_prior():
    jacobian, features, blocks, y = case(1)
    posterior = Flexible(features, blocks).posterior(y, jacobian)
    assert logsumexp(RIGHT) == pytest.approx(0.0) and logsumexp(UNKNOWN) == pytest.approx(0.0)
    assert posterior.right == pytest.approx(logsumexp(RIGHT + posterior.log_evidence))


def test_an_error_beyond_that_of_a_right_model_speaks_for_something_else():
    jacobian, features, blocks, y = case(2, signal=0.3)
    flexible = Flexible(features, blocks)
    loud, quiet = flexible.posterior(y, jacobian), flexible.posterior(case(2)[3], jacobian)
    assert logsumexp(UNKNOWN + loud.log_evidence) - loud.right > 5.0
    assert quiet.right > logsumexp(UNKNOWN + quiet.log_evidence)


def test_moments_are_those_of_the_mixture():
    """Against 200,000 draws: within five standard errors."""
    jacobian, features, blocks, y = case(3, signal=0.02)
    posterior = Flexible(features, blocks).posterior(y, jacobian)
    random, count = generator(3, "test", "mixture"), 200_000
    weights = np.exp(posterior.log_evidence + RIGHT - posterior.right)
    draws = np.concatenate(
        [
            random.multivariate_normal(mean, covariance, size)
            for mean, covariance, size in zip(
                posterior.mean, posterior.covariance, random.multinomial(count, weights), strict=True
            )
        ]
    )
    mean, covariance = posterior.moments()
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5.0 * sd / np.sqrt(count))
    assert np.sqrt(np.diag(np.cov(draws.T))) == pytest.approx(sd, rel=5.0 * 1.5 / np.sqrt(2 * count))


@given(st.integers(0, 20))
def test_inner_products_are_those_of_the_marginal_precision(seed):
    jacobian, features, blocks, y = case(seed, 0.1)
    other = generator(seed, "test", "other").standard_normal(ROWS)
    model = Projection(Flexible(features, blocks), jacobian)
    found = model.inner(model.weighted(y), model.weighted(other))
    for number, amplitude in enumerate(AMPLITUDES):
        covariance = np.eye(ROWS) + amplitude**2 * features @ features.T + jacobian @ jacobian.T
        assert found[number] == pytest.approx(y @ np.linalg.solve(covariance, other), rel=1e-6, abs=1e-6)


@given(st.integers(0, 20), st.floats(0.0, 50.0))
def test_errors_that_widen_the_noise_lower_the_evidence_of_a_fit(seed, widened):
    """Whitened by wider standard deviations, data fit better: log sd is not the same constant in all models then."""
    jacobian, features, blocks, y = case(seed)
    z = np.linalg.solve(np.eye(PARAMETERS) + jacobian.T @ jacobian, jacobian.T @ y)
    fits = [Fit(z, y - jacobian @ z, jacobian, flexible=Flexible(features, blocks, None, w)) for w in (0.0, widened)]
    assert fits[1].evidence == pytest.approx(fits[0].evidence - widened)
    assert fits[1].unreached == pytest.approx(0.0, abs=1e-6)
