"""Readings that say nothing new are left out or averaged; predictions are averaged like them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.seeds import generator
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.readings import PER_SECOND, dense, true_readings

PERIOD = 0.8


def noisy(times, seed):
    return (
        90.0
        + 20.0 * np.sin(2.0 * np.pi * times / PERIOD)
        + generator(seed, "test", "readings").standard_normal(times.size)
    )


@given(seed=st.integers(0, 100), count=st.integers(30, 200), every=st.integers(2, 6), first=st.integers(0, 3))
def test_linear_interpolation_is_undone(seed, count, every, first):
    true = np.linspace(0.0, PERIOD, count, endpoint=False)
    times = np.linspace(0.0, true[-1], (count - 1) * every + 1)[min(first, every - 1) :]
    values = np.interp(times, true, noisy(true, seed))
    kept = true_readings(times, values, np.ones(times.size))
    assert set(true[1:-1].round(9)) <= set(times[kept].round(9))
    assert kept.size <= count + every


@given(seed=st.integers(0, 200), count=st.integers(10, 300))
def test_true_readings_are_all_kept(seed, count):
    times = np.linspace(0.0, PERIOD, count, endpoint=False)
    assert true_readings(times, noisy(times, seed), np.ones(count)).size == count


@pytest.mark.parametrize("count", [40, 300])
def test_readings_without_noise_are_kept(count):
    """A smooth beat is everywhere nearly on the line between its neighbours."""
    times = np.linspace(0.0, PERIOD, count, endpoint=False)
    values = 90.0 + 20.0 * np.sin(2.0 * np.pi * times / PERIOD)
    assert true_readings(times, values, np.ones(count)).size == count


@pytest.mark.parametrize(("per_second", "size"), [(60.0, 1), (200.0, 1), (250.0, 2), (500.0, 3), (1000.0, 7)])
def test_dense_readings_are_averaged_to_what_is_needed(per_second, size):
    times = np.arange(0.0, PERIOD, 1.0 / per_second)
    readings = dense(times, PERIOD)
    if size == 1:
        assert readings is None
    else:
        assert readings.first[1] == size
        assert len(readings.first) / PERIOD < 1.5 * PER_SECOND


def test_an_average_has_the_noise_of_its_block():
    times = np.arange(800) / 1000.0
    readings, sd = dense(times, PERIOD), np.full(800, 2.0)
    draws = 2.0 * generator(4, "test", "readings").standard_normal((4000, 800))
    averages = readings.averaged(draws)
    error = readings.sd(sd) / np.sqrt(2 * 4000)
    assert np.abs(averages.std(axis=0) - readings.sd(sd)).max() < 5.0 * error.max()


def test_predictions_are_averaged_over_the_times_of_the_readings():
    """The average of a wave over a block is not the wave at the block's middle."""
    times = np.arange(0.0, PERIOD, 1e-3)
    readings = dense(times, PERIOD)
    grid = np.linspace(0.0, PERIOD, 4001)
    wave = np.sin(2.0 * np.pi * 20.0 * grid / PERIOD)
    series = Series("rest", "flow", "a:b", "waveform", readings.averaged(times), PERIOD, readings=readings)
    found = series.sampled(wave[None, :], PERIOD, np.zeros(1))[0]
    expected = [wave[np.searchsorted(grid, block)].mean() for block in np.split(times, readings.first[1:])]
    assert found == pytest.approx(expected, abs=2e-3)
    at_middle = np.interp(readings.averaged(times), grid, wave)
    assert np.abs(at_middle - expected).max() > 0.01
