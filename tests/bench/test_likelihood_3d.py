"""Samples of a posterior with 0D flows become some of that with 3D flows."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.posterior.model.likelihood import Likelihood
from support.benchmark_scripts import benchmark_script


@pytest.fixture(scope="module")
def script():
    return benchmark_script("likelihood_3d")


def test_the_weights_give_the_posterior_with_the_flows_of_3d(script):
    """One bed, all normal: flow θ by 0D, 0.97 θ by 3D; the posterior of θ is known with either."""
    random, prior, target, noise, share, n = np.random.default_rng(1), (1.0, 0.2), 1.1, 0.1, 0.97, 20_000

    def posterior(slope):
        precision = 1.0 / prior[1] ** 2 + (slope / noise) ** 2
        return (prior[0] / prior[1] ** 2 + slope * target / noise**2) / precision, precision**-0.5

    theta = posterior(1.0)[0] + posterior(1.0)[1] * random.standard_normal((n, 1))
    ffr = pd.DataFrame({"ffr_lad": theta[:, 0]})
    found = script.reweighted(Likelihood(np.array([target]), np.array([[noise**2]])), theta, share * theta, ffr)
    lad = found["ffr"]["ffr_lad"]
    change = posterior(share)[0] - posterior(1.0)[0]
    assert abs(lad["difference_of_means"] - change) < 4.0 * lad["its_standard_error"] < 0.2 * change
    mean, sd = posterior(share)
    assert lad["3d_likelihood"]["0.95"] == pytest.approx(mean + 1.645 * sd, abs=0.05 * sd)
    assert 0.8 < found["effective_share"] < 1.0


def test_equal_flows_change_nothing(script):
    flows = np.random.default_rng(2).uniform(0.9, 1.1, (50, 2))
    ffr = pd.DataFrame({"ffr_lad": flows[:, 0]})
    found = script.reweighted(Likelihood(np.ones(2), 0.01 * np.eye(2)), flows, flows, ffr)
    assert found["effective_share"] == pytest.approx(1.0) and found["pareto_k"] == 0.0
    assert found["ffr"]["ffr_lad"]["difference_of_means"] == pytest.approx(0.0, abs=1e-12)
