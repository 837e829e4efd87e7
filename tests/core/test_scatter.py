"""Scatter about the lines between neighbours: exact for lines, and seldom uneven by chance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from coronaryuq.core.scatter import far_off, larger_scatter, off_line, typical

TRIALS, SAMPLES = 2000, 40


def times(random: np.random.Generator, count: int = SAMPLES) -> np.ndarray:
    return np.cumsum(random.uniform(0.5, 1.5, count))


def off(random: np.random.Generator, sd: float, count: int = SAMPLES) -> np.ndarray:
    return off_line(times(random, count), sd * random.standard_normal(count))[1]


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.integers(3, 20), st.integers(0, 99))
def test_samples_of_a_line_are_on_it(start, slope, count, seed):
    time = times(np.random.default_rng(seed), count)
    values = start + slope * time
    line, found = off_line(time, values)
    assert line == pytest.approx(values[1:-1], abs=1e-9) and found == pytest.approx(0.0, abs=1e-9)


def test_white_noise_is_off_by_its_standard_deviation_however_samples_are_spaced():
    random = np.random.default_rng(1)
    squares = np.array([np.mean(off(random, 3.0) ** 2) for _ in range(TRIALS)])
    assert squares.mean() == pytest.approx(9.0, abs=4.0 * squares.std() / np.sqrt(TRIALS))
    sizes = np.array([np.log(typical(off(random, 3.0, 200)) / 3.0) for _ in range(TRIALS)])
    assert np.std(sizes) * np.sqrt(198) == pytest.approx(1.4, rel=0.1), "the error that `larger_scatter` takes"


def test_equal_noise_is_seldom_thought_to_be_uneven():
    """Of 2,000 sets of four groups; the quietest is the smallest of four, so that five standard errors are fewer."""
    random = np.random.default_rng(2)
    found = sum(bool(larger_scatter({k: off(random, 1.0) for k in range(4)})) for _ in range(TRIALS))
    assert found <= stats.binom.ppf(0.999, TRIALS, 1e-3)


def test_larger_noise_is_found_with_its_factor():
    random = np.random.default_rng(3)
    for _ in range(50):
        found = larger_scatter(
            {name: off(random, sd, 80) for name, sd in {"one": 1.0, "loud": 4.0, "too": 1.0}.items()}
        )
        assert list(found) == ["loud"] and found["loud"] == pytest.approx(4.0, rel=0.6)


def test_smooth_errors_are_no_noise():
    """As of an effect that the model lacks under one condition: ten times the noise, in the first harmonics."""
    random, phase = np.random.default_rng(4), np.linspace(0.0, 1.0, SAMPLES)
    wave = 10.0 * np.cos(2.0 * np.pi * phase) + 5.0 * np.sin(4.0 * np.pi * phase)
    for _ in range(50):
        noise = [random.standard_normal(SAMPLES) for _ in range(2)]
        assert not larger_scatter({k: off_line(phase, one + k * wave)[1] for k, one in enumerate(noise)})


def test_groups_without_scatter_or_samples_say_nothing():
    assert larger_scatter({}) == {}
    assert larger_scatter({"a": np.zeros(0), "b": np.ones(30)}) == {}
    assert larger_scatter({"constant": np.zeros(30), "b": np.ones(30)}) == {}


def loop(random):
    """Times of a period of `SAMPLES`, and noise of half a standard deviation."""
    return np.arange(SAMPLES) + random.uniform(-0.3, 0.3, SAMPLES), 0.5 * random.standard_normal(SAMPLES)


def test_far_off_samples_are_found_worst_first_and_neighbours_are_not_blamed():
    time, values = loop(np.random.default_rng(5))
    values[10] += 30.0
    values[25] -= 50.0
    assert [sample for sample, _ in far_off(time, values, 6.0, SAMPLES)] == [25, 10]
    assert far_off(time[:4], values[:4], 6.0, SAMPLES) == []
    assert far_off(time, values, 6.0, SAMPLES)[0][1] < 0.0 < far_off(time, values, 6.0, SAMPLES)[1][1]


@pytest.mark.parametrize("samples", [{0}, {39}, {10, 12}, {38, 0}, {1}])
def test_far_off_samples_are_found_at_the_ends_and_beside_others(samples):
    """The one between two of them is not far off, although it is off their line. At an end noise may hide one."""
    right = 0
    for seed in range(100):
        time, values = loop(np.random.default_rng(seed))
        values[list(samples)] += 15.0
        right += {sample for sample, _ in far_off(time, values, 6.0, SAMPLES)} == samples
    assert right >= 95


def test_ends_of_a_drift_or_of_a_part_of_the_period_are_not_far_off():
    for seed in range(200):
        time, values = loop(np.random.default_rng(seed))
        assert far_off(time, values + 30.0 * time / SAMPLES, 6.0, SAMPLES) == []
        assert far_off(time, values + 20.0 * np.cos(np.pi * time / SAMPLES), 6.0, 2.0 * SAMPLES) == []
