"""Multilevel BLUE against MFMC's closed form and against its own spread."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.blue import Group, blue, blue_variance
from coronaryuq.estimation.estimators.montecarlo import mfmc_mean, mfmc_variance

COVARIANCE = np.array([[4.0, 1.8, 1.0], [1.8, 1.0, 0.4], [1.0, 0.4, 1.0]])


def test_two_models_are_mfmc():
    rng = generator(1, "blue")
    y, q, more = rng.normal(size=12), rng.normal(size=12), rng.normal(size=30)
    part = COVARIANCE[:2, :2]
    means, spread = blue([Group((0, 1), np.column_stack([y, q])), Group((1,), more[:, None])], part)
    rho = part[0, 1] / np.sqrt(part[0, 0] * part[1, 1])
    assert means[0] == pytest.approx(mfmc_mean(y, q, more, part[0, 1] / part[1, 1]))
    assert spread[0, 0] == pytest.approx(mfmc_variance(part[0, 0], rho, 12, 42))


def test_claimed_variance_is_the_variance_seen_and_a_third_model_helps():
    counts = {(0, 1, 2): 10, (1, 2): 20, (2,): 100}
    root, trials = np.linalg.cholesky(COVARIANCE), 4000
    means = np.empty(trials)
    for t in range(trials):
        rng = generator(2, "blue", t)
        groups = [Group(m, (rng.normal(size=(n, 3)) @ root.T)[:, list(m)]) for m, n in counts.items()]
        means[t] = blue(groups, COVARIANCE)[0][0]
    claimed = blue_variance(counts, COVARIANCE)
    assert means.var() == pytest.approx(claimed, rel=5 * np.sqrt(2 / trials))
    assert abs(means.mean()) < 5 * np.sqrt(claimed / trials)
    assert claimed < blue_variance({(0, 1): 10, (1,): 20}, COVARIANCE) < blue_variance({(0,): 10}, COVARIANCE)


def test_a_model_that_nobody_ran_has_no_mean():
    means, _ = blue([Group((0,), np.ones((3, 1)))], COVARIANCE)
    assert means[0] == 1 and np.isnan(means[1:]).all()
