"""The joint covariance of several means against repeated trials."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import joint, per_row
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.runs.table import Row
from support.runs import runs_of

ROWS = [Row(name, name, "ffr", name) for name in ("a", "b", "c")]
TRIALS = 150


def trial(number: int):
    """Linear quantities with correlated noise, of which the 0D output explains a, and part of b."""
    rng = generator(11, "joint", number)
    theta, more = np.exp(rng.normal(size=(30, 2))), np.exp(rng.normal(size=(90, 2)))
    noise = rng.normal(size=(30, 3)) @ np.array([[0.5, 0.4, 0.0], [0.0, 0.3, -0.3], [0.0, 0.0, 0.3]])
    x = np.log(theta)
    y = dict(zip("abc", (np.column_stack([x[:, 0], x[:, 0] + x[:, 1], -x[:, 1]]) + noise).T, strict=True))
    runs = runs_of(theta, y, {"ffr": x[:, 0]}, more, q_more={"ffr": np.log(more[:, 0])})
    design = make_design(runs, ROWS, 5, number)
    estimates = [per_row.mfmc(design, ROWS[0], 0.95), per_row.mfmc(design, ROWS[1], 0.95)]
    estimates.append(per_row.monte_carlo(design, ROWS[2], 0.95))
    return np.array([e.mean for e in estimates]), joint.covariance(estimates), [e.std for e in estimates]


@pytest.mark.long
def test_the_reported_covariance_is_that_of_repeated_trials():
    means, reported, stds = zip(*(trial(number) for number in range(TRIALS)), strict=True)
    np.testing.assert_allclose([np.diag(c) for c in reported], np.square(stds))
    empirical, expected = np.cov(np.array(means), rowvar=False), np.mean(reported, axis=0)
    size = np.sqrt(np.diag(empirical))
    # Standard error of an entry of a correlation matrix: at most one over the root of the number of trials.
    np.testing.assert_allclose(expected / np.outer(size, size), empirical / np.outer(size, size), atol=4 / TRIALS**0.5)
    assert abs(empirical[0, 1]) > 4 / TRIALS**0.5 * size[0] * size[1]  # the two do have a covariance
