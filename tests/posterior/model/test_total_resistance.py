"""The constraint: coordinates keep it, the conditioned prior is the right one, rescaling samples another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled
from coronaryuq.posterior.sampler.dream import Dream
from coronaryuq.posterior.settings import DreamSettings

PRIOR = (0.5, 2.0)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.05, 1.0), min_size=2, max_size=20), st.integers(0, 2**32 - 1))
def test_coordinates_keep_the_total_resistance(weights, seed):
    space = Conditioned(np.array(weights), PRIOR)
    assert np.allclose(space.basis.T @ space.basis, np.eye(space.dimension), atol=1e-12)
    y = np.random.default_rng(seed).normal(size=(5, space.dimension)) * 0.1
    m = space.multipliers(y)
    valid = np.all(np.isfinite(m), axis=1)
    assert np.allclose(np.sum(space.weights / m[valid], axis=1), 1)
    assert np.allclose(space.coordinates(m[valid]), y[valid])


def test_rows_do_not_depend_on_each_other():
    space = Conditioned(np.arange(1.0, 15.0), PRIOR)
    y = space.draw(np.random.default_rng(0), 24)
    one_by_one = np.array([space.multipliers(row[None])[0] for row in y])
    assert np.array_equal(space.multipliers(y), one_by_one)


def conditioned_by_rejection(weights, count, random, width=0.004):
    """Uniform multipliers kept when their total conductance lies within `width` of r-hat's: no derivation in it."""
    kept = []
    while sum(map(len, kept)) < count:
        m = random.uniform(*PRIOR, size=(400_000, len(weights)))
        kept.append(m[np.abs(np.sum(weights / m, axis=1) - 1) < width])
    return np.concatenate(kept)[:count]


@pytest.fixture(scope="module")
def brute_force():
    weights = np.array([0.5, 0.3, 0.2])
    return weights, conditioned_by_rejection(weights, 6000, np.random.default_rng(7))


def test_prior_draws_agree_with_brute_force(brute_force):
    weights, reference = brute_force
    space = Conditioned(weights, PRIOR)
    draws = space.multipliers(space.draw(np.random.default_rng(1), 6000))
    assert np.all((draws >= PRIOR[0] * (1 - 1e-9)) & (draws <= PRIOR[1] * (1 + 1e-9)))
    for i in range(3):
        assert stats.ks_2samp(draws[:, i], reference[:, i]).pvalue > 1e-3


def chain_draws(space, generations=8000, thin=20):
    dream = Dream(
        lambda x: (space.log_prior(x), np.zeros((len(x), 0))), DreamSettings(generations=generations), 3,
        box=space.box, adjust=space.adjust,
    )  # fmt: skip
    state, draws = dream.start(space.draw(np.random.default_rng(2), 24)), []
    for _ in range(dream.decisions):
        dream.advance(state)
        draws.append(state.position.copy())
    return space.multipliers(np.concatenate(draws[dream.burn_in :: thin]))


@pytest.mark.long
def test_conditioned_chains_sample_it_and_rescaled_ones_do_not(brute_force):
    """The paper's rescaling after acceptance against the conditioned prior, flat likelihood."""
    weights, reference = brute_force
    conditioned, rescaled = chain_draws(Conditioned(weights, PRIOR)), chain_draws(Rescaled(weights, PRIOR))
    assert np.allclose(np.sum(weights / rescaled, axis=1), 1)
    for i in range(3):
        assert stats.ks_2samp(conditioned[:, i], reference[:, i]).pvalue > 1e-3
    assert min(stats.ks_2samp(rescaled[:, i], reference[:, i]).pvalue for i in range(3)) < 1e-8


def test_the_papers_draws_preserve_total_resistance(shared):
    """Published r fulfil sum w / r = 1 for positive w that add up to one: the constraint as stated here."""
    import pandas as pd

    table = pd.read_csv(shared / "data" / "menon2024" / "params.csv")
    multipliers = table[[c for c in table.columns if c.startswith("BC_")]].to_numpy()
    weights, *_ = np.linalg.lstsq(1 / multipliers, np.ones(len(multipliers)), rcond=None)
    assert np.all(weights > 0)
    assert np.isclose(weights.sum(), 1, atol=1e-5)
    assert np.std((1 / multipliers) @ weights) < 2e-6
