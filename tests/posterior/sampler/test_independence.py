"""Independence steps sample the target whatever the emulator is, and are nearly independent where it is good."""

import numpy as np
import pytest
from scipy import stats

from coronaryuq.core.importance_weights import pareto_smoothed
from coronaryuq.posterior.model.linearised import Linearised
from coronaryuq.posterior.sampler.exploration import Steps, Walk, explore
from coronaryuq.posterior.sampler.independence import Independence
from coronaryuq.posterior.settings import DreamSettings, IndependenceSettings, Settings
from support.known_targets import assert_moments, ess, exchange_asymmetry, gaussian, no_output, overdispersed


def about(start):
    """The Gaussian of the first states, which are wider spread than the target and off its mean."""
    return Linearised(start.mean(axis=0), np.linalg.cholesky(np.linalg.inv(np.cov(start.T))))


def run(log_density, screen, start, draws, walk=None, seed=1):
    """Draws (after burn-in, chains, d), log weights of the proposals, the walk and the last state."""
    settings = Settings(
        dream=DreamSettings(chains=len(start), generations=1000), independence=IndependenceSettings(draws=draws)
    )
    if walk is None:
        walk, rhat = explore(screen, start, about(start), settings.dream, seed)
        assert rhat < 1.05
    chains = Independence(no_output(log_density), screen, walk, settings, seed)
    state, states, weights = chains.start(start), [], []
    for _ in range(chains.decisions):
        chains.advance(state)
        states.append(state.position.copy())
        weights.append(state.log_weight.copy())
    return np.array(states[chains.burn_in :]), np.array(weights), walk, state


def wrong(log_density):
    """Another density on the same space: too wide, shifted, and wavy."""
    return lambda x: 0.6 * log_density(x) + 0.3 * x[:, 0] + 0.2 * np.sin(3 * x[:, 1])


@pytest.mark.slow
def test_a_good_emulator_gives_nearly_independent_draws():
    mean, covariance, log_density = gaussian(6)

    def screen(x):
        return 0.97 * log_density(x) + 0.02 * x[:, 0] + 7.0

    draws, weights, _, state = run(log_density, screen, overdispersed(mean, covariance, 24), 100)
    assert_moments(draws, mean, covariance)
    assert ess(draws).min() > 0.8 * draws.shape[0] * draws.shape[1]
    assert state.accepted.mean() / state.proposed > 0.9
    assert pareto_smoothed(weights.reshape(-1))[0] < 0.5
    assert state.evaluations == 24 * 101


@pytest.mark.slow
def test_a_wrong_emulator_costs_draws_and_no_correctness():
    mean, covariance, log_density = gaussian(4)
    start = overdispersed(mean, covariance, 24)
    draws, _, _, state = run(log_density, wrong(log_density), start, 150)
    assert_moments(draws, mean, covariance)
    assert state.accepted.mean() / state.proposed < 0.8
    emulated, *_ = run(wrong(log_density), wrong(log_density), start, 150)
    with pytest.raises(AssertionError):
        assert_moments(emulated, mean, covariance)


@pytest.mark.long
def test_twisted_target():
    """Haario's twist, b = 0.03, with an emulator whose b is a tenth smaller."""

    def untwisted(x, twist=0.03):
        y = x.copy()
        y[:, 1] += twist * x[:, 0] ** 2 - 100.0 * twist
        y[:, 0] /= 10.0
        return y

    def log_density(x):
        return -0.5 * np.sum(untwisted(x) ** 2, axis=1)

    start = np.random.default_rng(1).normal(size=(24, 5)) * 5
    draws, *_ = run(log_density, lambda x: -0.5 * np.sum(untwisted(x, 0.027) ** 2, axis=1), start, 100)
    normal = untwisted(draws.reshape(-1, 5)).reshape(draws.shape)
    assert ess(normal).min() > 200  # of 2280: an emulator with another twist costs draws, not correctness
    assert_moments(normal, np.zeros(5), np.eye(5))


def poor_walk(mean, covariance, generations):
    """Steps of a t that is too wide, and beside the target."""
    return Walk(mean + 1, np.linalg.cholesky(2 * covariance), generations, np.empty((0, len(mean))))


def test_detailed_balance_with_poor_and_few_steps():
    """Neither the length of the walk nor its t decide whether the draws are exact."""
    mean, covariance, log_density = target = gaussian(3)
    walk = poor_walk(mean, covariance, 4)

    def advance(seed, x):
        chains = Independence(no_output(log_density), wrong(log_density), walk, Settings(), seed)
        state = chains.start(x)
        chains.advance(state)
        return x, state.position

    assert np.all(np.abs(exchange_asymmetry(advance, target)) < 4.5)


def test_steps_leave_a_heavy_tailed_target_invariant_and_cross_its_tails():
    """A t of 3 degrees of freedom in 30 dimensions, by steps of one of 5: squared radii have the F distribution."""
    d, freedom, n = 30, 3.0, 400
    random = np.random.default_rng(3)
    start = random.standard_normal((n, d)) / np.sqrt(random.chisquare(freedom, size=(n, 1)) / freedom)

    def target(x):
        return -0.5 * (freedom + d) * np.log1p(np.sum(x**2, axis=1) / freedom)

    def within(x):
        return stats.f.cdf(np.sum(x**2, axis=1) / d, d, freedom)

    x, _, accepted, _ = Steps(np.zeros(d), np.eye(d)).walk(target, start, 200, np.random.default_rng(4))
    assert accepted.mean() > 0.6 * 200
    assert stats.kstest(within(x), "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(within(start), within(x))[0, 1]) < 4.5 / np.sqrt(n)


def test_many_chains_of_exact_draws_stay_exact():
    """After six steps with a wrong emulator, 600 independent chains have moved and have the target's moments."""
    mean, covariance, log_density = gaussian(5)
    start = np.random.default_rng(0).multivariate_normal(mean, covariance, size=600)
    settings = Settings(dream=DreamSettings(chains=600))
    chains = Independence(no_output(log_density), wrong(log_density), poor_walk(mean, covariance, 40), settings, 2)
    state = chains.start(start)
    for _ in range(6):
        chains.advance(state)
    assert np.mean(np.any(state.position != start, axis=1)) > 0.95
    z = (state.position - mean) / np.sqrt(np.diag(covariance))
    assert np.all(np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(600))
    assert np.all(np.abs(np.mean(z**2, axis=0) - 1) < 4.5 * np.sqrt(2 / 600))


@pytest.mark.slow
def test_log_weights_are_those_of_target_to_emulator_at_the_proposals():
    """A target a constant above its emulator has that constant everywhere, whether or not a proposal is accepted."""
    mean, covariance, log_density = gaussian(3)
    start = overdispersed(mean, covariance, 12)
    _, weights, *_ = run(log_density, lambda x: log_density(x) - 2.5, start, 30)
    assert np.allclose(weights, 2.5)
    outside = 40.0

    def cut(x):
        return np.where(x[:, 0] < mean[0], log_density(x), log_density(x) - outside)

    draws, weights, *_ = run(cut, log_density, np.where(start > mean, 2 * mean - start, start), 30)
    assert np.all(draws[:, :, 0] < mean[0])
    assert 0.3 < np.mean(np.isclose(weights, -outside)) < 0.7
    assert np.all(np.isclose(weights, 0) | np.isclose(weights, -outside))
