"""Multilevel BLUE: weights against closed forms, claims against repeated trials."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.blue import Group, estimate, weights
from coronaryuq.estimation.estimators.formulas import mfmc_variance

# A 3D model, its coarse mesh, two 0D outputs.
COVARIANCE = np.array([[4.0, 3.6, 1.8, 0.6], [3.6, 4.0, 1.7, 0.5], [1.8, 1.7, 1.0, 0.1], [0.6, 0.5, 0.1, 1.0]])
COUNTS = [((0, 1, 2, 3), 40), ((1, 2, 3), 160), ((2, 3), 1000)]


def variance(counts, covariance=COVARIANCE):
    """Of the weighted sum of the groups' means, which are independent of each other."""
    pairs = zip(counts, weights(counts, covariance), strict=True)
    return sum(w @ covariance[np.ix_(models, models)] @ w / n for (models, n), w in pairs)


def test_weights_of_the_target_model_add_up_to_one_and_those_of_the_others_to_zero():
    total = np.zeros(4)
    for (models, _), w in zip(COUNTS, weights(COUNTS, COVARIANCE), strict=True):
        total[list(models)] += w
    np.testing.assert_allclose(total, [1, 0, 0, 0], atol=1e-12)


def test_the_variance_is_that_of_the_normal_equations():
    """Generalised least squares of all groups' means on the models' means: the first entry of (Σ P' C⁻¹ P)⁻¹."""
    precision = np.zeros((4, 4))
    for models, n in COUNTS:
        precision[np.ix_(models, models)] += n * np.linalg.inv(COVARIANCE[np.ix_(models, models)])
    assert variance(COUNTS) == pytest.approx(np.linalg.inv(precision)[0, 0])


def test_two_models_are_mfmc_and_every_further_model_helps():
    two = COVARIANCE[:2, :2]
    assert variance([((0, 1), 40), ((1,), 160)], two) == pytest.approx(mfmc_variance(4, two[0, 1] / 4, 40, 200))
    assert variance(COUNTS) < variance([((0, 1), 40), ((1,), 160)]) < variance([((0,), 40)]) == pytest.approx(4 / 40)


def test_weights_do_not_depend_on_the_units_of_the_models():
    units = np.array([1e-6, 1e4, 1e-2, 1e8])
    scaled = weights(COUNTS, COVARIANCE * np.outer(units, units))
    for (models, _), w, other in zip(COUNTS, weights(COUNTS, COVARIANCE), scaled, strict=True):
        np.testing.assert_allclose(other * units[list(models)], w * units[0], rtol=1e-7)


def test_a_model_that_the_others_determine_has_the_mean_of_all_their_samples():
    """The pilot's own covariance is singular: y is a linear combination of the first cheap model, and noise is not."""
    rng = generator(6, "exact")
    cheap, more = rng.normal(5, 1, (30, 2)), rng.normal(5, 1, (500, 2))
    y = 1 + 0.1 * cheap[:, 0]
    got = estimate([Group((0, 1, 2), np.column_stack([y, cheap])), Group((1, 2), more)], 5, 1)
    assert got.mean == pytest.approx(1 + 0.1 * np.concatenate([cheap, more])[:, 0].mean(), abs=2e-3)
    assert got.std == pytest.approx(0.1 / 530**0.5, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("n", [25, 50])
def test_cross_fitted_claims_hold_and_approach_the_closed_form(n):
    """Skewed models with means far from zero; 400 trials, bounds 15 % and three binomial standard errors."""
    root, trials = np.linalg.cholesky(COVARIANCE), 400
    error, claim, holds = np.empty(trials), np.empty(trials), np.empty(trials, bool)
    counts = [((0, 1, 2, 3), n), ((1, 2, 3), 4 * n), ((2, 3), 1000)]
    for t in range(trials):
        rng = generator(6, "blue", n, t)
        groups = [Group(m, (10 + (rng.gamma(4, 0.5, (k, 4)) - 2) @ root.T)[:, list(m)]) for m, k in counts]
        got = estimate(groups, 10, t)
        error[t], claim[t], holds[t] = got.mean - 10, got.std**2, got.interval.holds(10)
    assert np.sqrt(claim.mean()) / error.std() == pytest.approx(1, abs=0.15)
    assert holds.mean() >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / trials)
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(trials)
    assert claim.mean() < 1.3 * variance(counts)
