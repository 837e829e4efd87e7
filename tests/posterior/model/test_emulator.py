"""Fit of flow fractions, design, emulator: accurate near the posterior, and the same density as the model's."""

import numpy as np
from scipy import stats

from coronaryuq.posterior.model.emulator import Emulator, _per_gram
from coronaryuq.posterior.model.fit_to_fractions import fit_fractions
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.linearised import Linearised, design_size
from coronaryuq.posterior.model.total_resistance import Conditioned
from support.resistor_tree import ResistorTree, targets_of


def prepared(count=14):
    tree = ResistorTree.of(count)
    likelihood = Likelihood(*targets_of(tree))
    space = Conditioned(tree.weights, (0.5, 2.0))
    fit = fit_fractions(tree.flows, tree.weights, likelihood.mean)
    random = np.random.default_rng(1)
    y = Linearised.about(space, likelihood, fit.multipliers, fit.flows).design(
        space, design_size(space.dimension), random
    )
    return tree, likelihood, space, fit, Emulator.fit(y, space.multipliers(y), tree.flows(space.multipliers(y)))


def test_fit_meets_target_fractions():
    tree, likelihood, _, fit, _ = prepared(17)
    wanted = likelihood.mean / likelihood.mean.sum()
    assert np.max(np.abs(fit.flows / fit.flows.sum() / wanted - 1)) < 1e-4
    assert np.isclose(np.sum(tree.weights / fit.multipliers), 1)
    assert fit.runs < 15


def test_fit_says_how_far_an_unreachable_target_is():
    tree = ResistorTree.of(4)
    greedy = np.array([50.0, 1.0, 1.0, 1.0]) * tree.flows(np.ones((1, 4)))[0]
    fit = fit_fractions(tree.flows, tree.weights, greedy)
    assert fit.error > 0.0


def test_emulator_is_far_more_accurate_than_the_targets():
    tree, likelihood, space, fit, emulator = prepared()
    random = np.random.default_rng(2)
    y = Linearised.about(space, likelihood, fit.multipliers, fit.flows).design(space, 500, random, width=1.0)
    m = space.multipliers(y)
    error = np.abs(emulator.flows(y, m) / tree.flows(m) - 1)
    assert error.max() < 0.005
    assert np.all(emulator.error < 0.001)
    posterior, screen = Posterior(tree, space, likelihood), emulator.screen(space, likelihood)
    assert np.max(np.abs(screen(y) - posterior(y)[0])) < 0.05


def test_a_state_without_a_steady_flow_is_impossible():
    inverse = np.array([[1.0], [np.nan], [np.inf]])
    one, x = np.ones(1), np.zeros((3, 1))
    likelihood = one, np.eye(1), 0.0
    density = _per_gram(x, x, inverse, 0.0 * one, one, np.zeros((1, 2)), *likelihood, 0.0 * one, np.eye(1), -np.inf)
    assert density.tolist() == [0.0, -np.inf, -np.inf]


def test_emulated_density_is_that_of_emulated_flows():
    _, likelihood, space, _, emulator = prepared(5)
    y = space.draw(np.random.default_rng(0), 50)
    expected = space.log_prior(y) + likelihood.log_density(emulator.flows(y, space.multipliers(y)))
    screen = emulator.screen(space, likelihood)
    assert np.allclose(screen(y), expected, rtol=1e-10)
    outside = y + 5.0
    assert np.all(np.isneginf(screen(outside)))
    assert np.all(np.isneginf(space.log_prior(outside)))


def test_the_defensive_component_is_a_student_t_with_its_share(count=4):
    """Beside a Gaussian posterior it has a tenth of the mass; it stays where the emulated posterior vanishes."""
    _, likelihood, space, fit, emulator = prepared(count)
    linearised = Linearised.about(space, likelihood, fit.multipliers, fit.flows)
    centre, precision = linearised.centre, linearised.factor @ linearised.factor.T
    defended = emulator.defended(linearised, space, likelihood)
    y = linearised.design(space, 300, np.random.default_rng(0), width=4.0)
    emulated, mixed = (one.screen(space, likelihood)(y) for one in (emulator, defended))
    top = emulator.screen(space, likelihood)(centre[None])[0]
    gaussian = top - stats.multivariate_normal(centre, np.linalg.inv(precision)).logpdf(centre)
    t = stats.multivariate_t(centre, np.linalg.inv(precision), df=5).logpdf(y)
    assert np.allclose(mixed, np.logaddexp(emulated, gaussian + np.log(0.1) + t), rtol=1e-9)
    assert np.max(mixed - emulated) > 4 and np.all(mixed >= emulated)
    assert np.all(np.isneginf(defended.screen(space, likelihood)(y + 5.0)))
