"""Predictions at a part of the propagation samples, carried over to the others."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import design as designs
from coronaryuq.estimation.estimators import per_row
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.estimators.regression import Regression
from coronaryuq.estimation.runs.table import Row
from coronaryuq.estimation.surrogates import gaussian_process
from support.runs import runs_of

ROW = Row("1", "y", "q", "")


def inputs(m: int, d: int, seed: int = 1) -> np.ndarray:
    return np.exp(0.3 * generator(3, "regression", m, d, seed).normal(size=(m, d)))


def regression_on(theta: np.ndarray, known: np.ndarray, integrated: str | None = None) -> Regression:
    pilot = theta[:4]
    runs = runs_of(pilot, {"y": np.zeros(4)}, {"q": np.arange(4.0)}, theta)
    return Regression.of(runs, np.arange(len(theta)), known, integrated)


def quadratic(x: np.ndarray) -> np.ndarray:
    return 2 + x @ np.arange(1, x.shape[1] + 1) + (x[:, 0] - x[:, -1]) ** 2


@settings(max_examples=20, deadline=None)
@given(d=st.integers(1, 4), m=st.integers(200, 9000), seed=st.integers(0, 99))
def test_a_quadratic_function_is_known_everywhere(d, m, seed):
    theta = inputs(m, d, seed)
    g = quadratic(np.log(theta))
    known = np.sort(generator(3, "known", seed).permutation(m)[: max(150, m // 5)])
    assert regression_on(theta, known).to_all(g[known]) == pytest.approx(g, rel=1e-9)


@settings(max_examples=20, deadline=None)
@given(m=st.integers(400, 9000), part=st.floats(0.2, 0.9), seed=st.integers(0, 99))
def test_the_mean_is_that_of_the_polynomial_plus_that_of_the_residuals(m, part, seed):
    theta = inputs(m, 2, seed)
    x = np.log(theta)
    g = np.sin(5 * x[:, 0]) + x[:, 1]
    known = np.sort(generator(3, "known", seed).permutation(m)[: int(part * m)])
    columns = np.column_stack([np.ones(m), x, x[:, 0] ** 2, x[:, 0] * x[:, 1], x[:, 1] ** 2])
    h = columns @ np.linalg.lstsq(columns[known], g[known], rcond=None)[0]
    found = regression_on(theta, known).to_all(g[known])
    assert found.mean() == pytest.approx(h.mean() + np.mean(g[known] - h[known]), abs=1e-9)


@settings(max_examples=20, deadline=None)
@example(cut=7, last=1, seed=52)
@given(cut=st.integers(1, 7), last=st.integers(1, gaussian_process.BLOCK), seed=st.integers(0, 99))
def test_predictions_have_the_same_bits_in_any_number_of_blocks(cut, last, seed):
    x = np.log(inputs(40, 3, seed))
    process = gaussian_process.fit(x, np.sin(3 * x[:, 0]) + x[:, 1], evaluations=5)
    new, cut = (
        generator(3, "new", seed).normal(size=(7 * gaussian_process.BLOCK + last, 3)),
        cut * gaussian_process.BLOCK,
    )
    in_blocks = np.concatenate([process.predict(new[:cut]), process.predict(new[cut:])])
    assert np.array_equal(in_blocks, process.predict(new))


@pytest.mark.slow
def test_the_variance_of_the_values_is_that_of_their_mean():
    """400 trials: both standard deviations of a ratio of variances are 7 %."""
    means, claims, m = [], [], 3000
    for trial in range(400):
        theta = inputs(m, 2, trial)
        x = np.log(theta) / 0.3
        g = x[:, 0] + 0.5 * np.sin(9 * x[:, 1])
        known = np.sort(generator(3, "known", trial).permutation(m)[:300])
        found = regression_on(theta, known).to_all(g[known])
        means.append(found.mean())
        claims.append(np.var(found, ddof=1) / m)
    assert np.mean(claims) / np.var(means) == pytest.approx(1, abs=4 * (2 / 400) ** 0.5)
    assert abs(np.mean(means)) < 4 * (np.var(means) / 400) ** 0.5


@pytest.mark.slow
@pytest.mark.parametrize("real_0d", [False, True])
def test_fewer_predictions_hardly_widen_the_estimate(monkeypatch, real_0d):
    rng = generator(3, "pilot")
    theta, more = np.exp(0.3 * rng.normal(size=(60, 2))), inputs(4000, 2)

    def low(t):
        return 1 / (t[:, 0] + 0.2 * t[:, 1])

    y = np.log(low(theta)) + 0.3 * np.log(theta[:, 1]) ** 2 + 0.01 * rng.normal(size=60)
    runs = runs_of(theta, {"y": y}, {"q": low(theta)}, more)
    if real_0d:
        runs = replace(runs, q_more=runs.q.iloc[:0].reindex(range(4000)).assign(q=low(more)))
    found = []
    for most in (4000, 800):
        monkeypatch.setattr(designs, "MOST", most)
        design = make_design(runs, [ROW], 5, 1)
        predictions = per_row.predict(design, ROW)
        found.append((per_row.mfmc(design, ROW, 0.95), per_row.crossfit_gp(design, ROW, predictions, 0.95)))
        assert found[-1][1].predictions == most
    for all_predicted, some in zip(*found, strict=True):
        apart = (some.contributions - all_predicted.contributions).variance
        assert abs(some.mean - all_predicted.mean) < 4 * apart**0.5 + 1e-12
        assert some.std == pytest.approx(all_predicted.std, rel=0.1)
        assert len(some.contributions.propagated) == 4000
