"""Any number of models: `coronaryuq.estimate_models` and `coronaryuq.allocate`."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import coronaryuq
from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import blue, formulas
from coronaryuq.estimation.models import GAP, Allocation, allocate, estimate_models

MODELS = ["fine", "coarse", "zerod", "other"]
COVARIANCE = np.array([[4.0, 3.6, 1.8, 0.6], [3.6, 4.0, 1.7, 0.5], [1.8, 1.7, 1.0, 0.1], [0.6, 0.5, 0.1, 1.0]])
COSTS = [1.0, 0.1, 0.001, 0.002]


def sampled(n: int, models: list[str], *name) -> pd.DataFrame:
    """Normal outputs of mean 10 with COVARIANCE, of some of the models."""
    drawn = 10 + generator(9, "models", *name).normal(size=(n, 4)) @ np.linalg.cholesky(COVARIANCE).T
    return pd.DataFrame(drawn, columns=MODELS)[models]


def variance(allocation: Allocation) -> float:
    """Of BLUE for the samples of an allocation."""
    counts = [
        (tuple(MODELS.index(name) for name in subset), n)
        for subset, n in zip(allocation.subsets, allocation.samples, strict=True)
    ]
    pairs = zip(counts, blue.weights(counts, COVARIANCE), strict=True)
    return sum(w @ COVARIANCE[np.ix_(models, models)] @ w / n for (models, n), w in pairs)


def cost(allocation: Allocation) -> float:
    prices = dict(zip(MODELS, COSTS, strict=True))
    return sum(
        n * sum(prices[name] for name in subset)
        for subset, n in zip(allocation.subsets, allocation.samples, strict=True)
    )


def test_groups_of_any_nesting_are_combined():
    """A group without the coarse model, one without the 0D models, and one of the second 0D model alone."""
    groups = [
        sampled(40, MODELS, "pilot"), sampled(300, ["other", "zerod"], "0D"), sampled(160, ["coarse"], "coarse"),
        sampled(500, ["other"], "other"),
    ]  # fmt: skip
    got = estimate_models(groups)
    assert abs(got.mean - 10) < 4 * got.std and got.interval.low < got.mean < got.interval.high
    assert got.std < 0.7 * groups[0]["fine"].std() / 40**0.5
    assert got.residual_variance + got.propagation_variance == pytest.approx(got.std**2)
    counts = [((0, 1, 2, 3), 40), ((3, 2), 300), ((1,), 160), ((3,), 500)]
    pairs = zip(counts, blue.weights(counts, COVARIANCE), strict=True)
    exact = sum(w @ COVARIANCE[np.ix_(models, models)] @ w / n for (models, n), w in pairs)
    assert got.std == pytest.approx(exact**0.5, rel=0.3)


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda g: [], "estimate_models: groups: empty"),
        (lambda g: [g[0].head(19), g[1]], "estimate_models: group 0 = 19: samples; at least 20 are needed"),
        (lambda g: [g[0], g[1].rename(columns={"coarse": "corse"})], "estimate_models: group 1 = 'corse': not a model"),
        (lambda g: [g[0], g[0]], "estimate_models: group 1 = 'fine': the expensive model belongs into the first group"),
        (lambda g: [g[0], g[1].replace(g[1].iat[7, 0], np.nan)], "estimate_models: group 1, row 7, coarse = nan"),
        (lambda g: [g[0], g[1].assign(coarse="a")], "estimate_models: group 1: expected numbers"),
    ],
)  # fmt: skip
def test_wrong_groups_are_one_line(spoil, line):
    with pytest.raises(InputError) as caught:
        estimate_models(spoil([sampled(30, ["fine", "coarse"], "few"), sampled(60, ["coarse"], "more")]))
    assert str(caught.value).startswith(line) and "\n" not in str(caught.value)


def test_more_models_than_the_pilot_supports_are_one_line():
    with pytest.raises(InputError, match="group 0 = 25: samples; at least 30 are needed"):
        estimate_models([sampled(25, MODELS, "small")])


def test_the_allocation_of_two_models_is_the_closed_form():
    got = allocate(COVARIANCE[:2, :2], [1, 0.01], 100, [(0, 1), (1,)])
    n_3d, n_0d = formulas.optimal_allocation(100, 0.01, 0.9)
    np.testing.assert_allclose(got.samples, [n_3d, n_0d - n_3d], rtol=1e-3)
    assert got.variance == pytest.approx(formulas.optimal_variance(4, 100, 0.01, 0.9), rel=2 * GAP)


def test_an_allocation_over_all_subsets_uses_the_budget_and_beats_fewer_subsets():
    every = allocate(pd.DataFrame(COVARIANCE, columns=MODELS, index=MODELS), COSTS, 100)
    nested = allocate(COVARIANCE, COSTS, 100, [(0, 1, 2, 3), (1, 2, 3), (2, 3)])
    two = allocate(COVARIANCE[:2, :2], COSTS[:2], 100)
    assert cost(every) == pytest.approx(100, rel=1e-3)
    assert variance(every) == pytest.approx(every.variance, rel=1e-3)
    assert every.variance < nested.variance < two.variance < 4 / 100
    table = every.table()
    assert {"fine", "zerod", "samples"} <= set(table.columns) <= {*MODELS, "samples"} and (table["samples"] > 0).all()


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.005, 0.5), st.floats(1e-4, 0.05))
def test_no_random_allocation_of_the_budget_beats_the_best_one(seed, coarse, cheap):
    rng = generator(seed, "allocation")
    factor = rng.normal(size=(3, 3))
    covariance, costs = factor @ factor.T + 0.05 * np.eye(3), np.array([1.0, coarse, cheap])
    subsets = [(0, 1, 2), (0, 1), (0, 2), (1, 2), (0,), (1,), (2,)]
    least = allocate(covariance, costs, 1000, subsets).variance
    prices = np.array([costs[list(subset)].sum() for subset in subsets])
    for share in rng.dirichlet(np.full(len(subsets), 0.3), 40) + 1e-9:
        counts = list(zip(subsets, 1000 * share / share.sum() / prices, strict=True))
        pairs = zip(counts, blue.weights(counts, covariance), strict=True)
        assert sum(w @ covariance[np.ix_(m, m)] @ w / n for (m, n), w in pairs) >= least * (1 - 2 * GAP)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"covariance": np.ones((2, 2))}, "allocate: covariance: not positive definite"),
        ({"covariance": np.ones((2, 3))}, "allocate: covariance = (2, 3): expected a symmetric matrix"),
        ({"costs": [1, 0]}, "allocate: costs = [1.0, 0.0]: expected 2 positive numbers"),
        ({"budget": 0}, "allocate: budget = 0: expected a positive number"),
        ({"budget": 0.01}, "allocate: budget = 0.01: less than the cost of one run of model_0"),
        ({"subsets": [(1,)]}, "allocate: subsets: none has model_0"),
        ({"subsets": [("0D",)]}, "allocate: subsets = '0D': no such model"),
    ],
)
def test_wrong_arguments_of_an_allocation_are_one_line(change, line):
    with pytest.raises(InputError) as caught:
        allocate(**{"covariance": [[2.0, 1.0], [1.0, 2.0]], "costs": [1, 0.1], "budget": 50} | change)
    assert str(caught.value).startswith(line)


def test_they_are_public_names():
    assert coronaryuq.estimate_models is estimate_models and coronaryuq.allocate is allocate
