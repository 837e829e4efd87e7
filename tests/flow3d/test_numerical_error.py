"""Numerical errors: a known order is found and removed, an unknown one bounded, and the bounds hold."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.seeds import generator
from coronaryuq.flow3d.numerical_error import numerical_error, observed_order

SIZE = np.array([1.28, 1.0, 0.78])
"""Element sizes of a coarse mesh, the campaign's and a fine one."""


def on_three(law, samples=4):
    """Values (3, samples) of a law of the element size whose limit is 0.8 for the first sample, more for others."""
    return np.array([[0.8 + 0.01 * k + law(h) for k in range(samples)] for h in SIZE])


@given(st.floats(1.001, 2.0), st.floats(-0.1, 0.1).filter(lambda factor: abs(factor) > 1e-3))
def test_a_manufactured_order_is_seen_and_its_error_removed(power, factor):
    values = on_three(lambda h: factor * h**power)
    found = numerical_error("mesh", SIZE, values, 1)
    assert found.method == "richardson" and found.order == pytest.approx(power, rel=1e-5)
    assert found.correction == pytest.approx(-factor, rel=1e-5)
    assert found.std == pytest.approx(1.25 * abs(factor) / 2, rel=1e-5)
    assert found.n_samples == 4 and found.spread == pytest.approx(0.0, abs=1e-9)


def test_an_order_above_the_methods_is_corrected_by_the_methods():
    values = on_three(lambda h: 0.01 * h**3)
    found = numerical_error("mesh", SIZE, values, 1)
    of_second_order = (values[2, 0] - 0.78**2 * values[1, 0]) / (1 - 0.78**2) - values[1, 0]
    assert found.order == pytest.approx(3.0) and found.correction == pytest.approx(of_second_order)


@pytest.mark.parametrize("law", [lambda h: 0.01 * h**0.5, lambda h: 0.01 * h**5, lambda h: 0.01 * np.cos(12 * h)])
def test_an_order_that_is_not_trusted_corrects_nothing(law):
    values = on_three(law)
    found = numerical_error("mesh", SIZE, values, 1)
    assert (found.method, found.correction) == ("range", 0.0)
    assert found.std == pytest.approx(1.5 * np.ptp(values[:, 0]))


def test_values_that_turn_round_have_no_order():
    assert observed_order(SIZE, np.array([1.0, 1.2, 1.1])) is None


def test_two_levels_assume_the_methods_order_and_correct_nothing():
    values = on_three(lambda h: 0.01 * h**2)[:2]
    found = numerical_error("mesh", SIZE[:2], values, 1)
    assert (found.method, found.correction, found.order) == ("two_levels", 0.0, None)
    assert found.std == pytest.approx(1.5 * 0.01)


def test_halving_the_step_halves_its_error():
    steps = np.array([1 / 300, 1 / 600])
    values = np.array([[0.81 + 6.0 * step] for step in steps])
    assert numerical_error("time_step", steps, values, 1).std == pytest.approx(1.5 * 0.01)


def test_a_geometric_approach_to_the_periodic_state_is_followed_to_its_end():
    values = np.array([[0.8 + 0.01 * 0.6**cycle] for cycle in (1, 2, 3)])
    found = numerical_error("cycles", np.array([4.0, 2.0, 1.0]), values, 2)
    assert found.correction == pytest.approx(-0.01 * 0.6**3)


def test_the_scatter_between_samples_is_part_of_the_uncertainty():
    random = generator(1, "scatter")
    values = np.zeros((2, 16)) + 0.01 * random.normal(size=16) * SIZE[:2, None] ** 2
    values -= values.mean(axis=1, keepdims=True)
    found = numerical_error("mesh", SIZE[:2], values, 1)
    assert found.std == pytest.approx(found.spread / 4) and found.spread > 0


def covered(kind, trials=1000):
    """Share of trials whose 95 % interval holds the limit, 0. kind: random generator → values (3,)."""
    random = generator(2, "coverage")
    inside = 0
    for _ in range(trials):
        values = kind(random)
        found = numerical_error("mesh", SIZE, values[:, None], 1)
        inside += abs(values[1] + found.correction) <= 1.96 * found.std
    return inside / trials


def converging(noise):
    def values(random):
        return random.normal() * SIZE ** random.uniform(1.0, 2.0) + noise * random.normal(size=3)

    return values


@pytest.mark.parametrize(
    ("kind", "least"),
    [
        (converging(0.0), 0.99),
        (converging(0.05), 0.93),
        (converging(0.3), 0.90),
        (lambda random: random.normal() * SIZE ** random.uniform(2.0, 7.0) + 0.05 * random.normal(size=3), 0.95),
        (lambda random: random.normal(size=3), 0.95),
    ],
    ids=["order 1 to 2", "with scatter of the meshes", "with much scatter", "order 2 to 7", "scatter alone"],
)
def test_intervals_hold_the_limit(kind, least):
    assert covered(kind) >= least


def test_intervals_of_two_levels_hold_the_limit_of_scattered_values():
    random = generator(3, "coverage")
    values = random.normal(size=(2000, 2))
    errors = [numerical_error("mesh", SIZE[:2], pair[:, None], 1) for pair in values]
    inside = np.mean([abs(pair[1]) <= 1.96 * error.std for pair, error in zip(values, errors, strict=True)])
    assert 0.88 <= inside <= 0.97
