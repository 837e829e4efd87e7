"""A measured drive is smooth between its readings; its noise is removed where the circulation has no content."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.zerod.network.waveforms import CONTENT, HARMONICS, WAVE_POINTS, without_noise


def beat(time, highest, seed):
    """A beat with content up to a frequency, Hz."""
    random, count = generator(seed, "test", "drive"), int(highest * time[-1])
    angles = 2.0 * np.pi * np.outer(time / time[-1], np.arange(1, count + 1))
    cosines, sines = random.standard_normal((2, count)) / np.arange(1, count + 1)
    return 9e4 + 2e4 * (np.cos(angles) @ cosines + np.sin(angles) @ sines)


@given(seed=st.integers(0, 50), count=st.integers(100, 400), period=st.floats(0.4, 1.0))
def test_content_stays_and_what_is_beyond_is_removed(seed, count, period):
    time = np.linspace(0.0, period, count + 1)
    smooth = beat(time, min(CONTENT, 0.4 * count / period), seed)
    harmonic = int(0.45 * count)
    noisy = smooth + 300.0 * np.cos(2.0 * np.pi * harmonic * time / period)
    at, found = without_noise(time, noisy)
    at_readings = CubicSpline(at, found, bc_type="periodic")(time)
    assert at_readings == pytest.approx(smooth if harmonic > CONTENT * period else noisy, abs=2.0)


@given(seed=st.integers(0, 50), count=st.integers(45, 400))
def test_between_readings_a_beat_is_smooth(seed, count):
    """With straight lines between 45 readings, 10 Hz would lose a tenth of their amplitude half-way."""
    time, fine = (np.linspace(0.0, 0.8, points + 1) for points in (count, 4800))
    at, found = without_noise(time, beat(time, 20.0, seed))
    assert len(at) == len(found) == WAVE_POINTS
    assert np.interp(fine, at, found) == pytest.approx(beat(fine, 20.0, seed), abs=50.0)


def test_readings_too_few_for_a_beat_are_left_as_they_are():
    time = np.sort(generator(1, "test", "drive").uniform(0.0, 0.8, 2 * HARMONICS))
    time[[0, -1]] = 0.0, 0.8
    values = generator(2, "test", "drive").standard_normal(2 * HARMONICS)
    at, found = without_noise(time, values)
    assert np.array_equal(at, time) and np.array_equal(found, values)


def test_a_drive_has_its_noise_removed():
    time = np.linspace(0.0, PERIOD, 301)
    values = beat(time, 10.0, 3)
    noise = np.append(generator(4, "test", "drive").standard_normal(300), 0.0)
    network = apply_condition(left_coronary(), Condition("rest", drive={"AORTA": (time, values + 300.0 * noise)}))
    (inlet,) = (b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == "AORTA")
    left = np.array(inlet["P"]) - beat(np.array(inlet["t"]), 10.0, 3)
    # Of white noise, the share of the frequencies up to the limit is left.
    assert np.std(left) == pytest.approx(300.0 * np.sqrt(CONTENT * PERIOD / 150.0), rel=0.25)
