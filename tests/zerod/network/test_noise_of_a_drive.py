"""Noise of a measured drive is removed where the circulation has no content, and only there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.zerod.network.waveforms import CONTENT, without_noise


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
    assert at == pytest.approx(time, abs=1e-12)
    assert found == pytest.approx(smooth if harmonic > CONTENT * period else noisy, abs=1e-4)


def test_readings_too_far_apart_for_such_content_are_left_as_they_are():
    time = np.sort(generator(1, "test", "drive").uniform(0.0, 0.8, 40))
    time[[0, -1]] = 0.0, 0.8
    values = generator(2, "test", "drive").standard_normal(40)
    at, found = without_noise(time, values)
    assert np.array_equal(at, time) and np.array_equal(found, values)


def test_a_drive_has_its_noise_removed():
    time = np.linspace(0.0, PERIOD, 301)
    values = beat(time, 10.0, 3)
    noise = np.append(generator(4, "test", "drive").standard_normal(300), 0.0)
    network = apply_condition(left_coronary(), Condition("rest", drive={"AORTA": (time, values + 300.0 * noise)}))
    (inlet,) = (b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == "AORTA")
    left = np.array(inlet["P"]) - values
    # Of white noise, the share of the frequencies up to the limit is left.
    assert np.std(left) == pytest.approx(300.0 * np.sqrt(CONTENT * PERIOD / 150.0), rel=0.25)
