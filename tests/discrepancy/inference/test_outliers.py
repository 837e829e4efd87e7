"""Outliers are found where they are put, and nowhere else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.outliers import find_outliers
from support.series_problem import series_problem, waveform

SAMPLES, PERIOD = 40, 0.8
CONDITIONS = ("rest", "pacing", "hyperaemia", "drug")


def series(condition, seed):
    jitter = np.random.default_rng(seed).uniform(-0.3, 0.3, SAMPLES)
    time = (np.arange(SAMPLES) + 0.5 + jitter) / SAMPLES * PERIOD
    return waveform(time, PERIOD, condition)


MEASURED = [series(condition, number) for number, condition in enumerate(CONDITIONS)]
PERFUSION = Measured("rest", "perfusion", "BC_lad", "mean", None, PERIOD, np.zeros(1), np.ones(1))
PROBLEM = series_problem([*MEASURED, PERFUSION])
ROWS = len(PROBLEM.owner)


def found(residual):
    return {(one.condition, one.time, np.sign(one.off)) for one in find_outliers(PROBLEM, residual)}


def noise(seed):
    return np.random.default_rng(seed).standard_normal(ROWS)


@pytest.mark.slow
def test_noise_and_smooth_residuals_have_hardly_an_outlier():
    """In 5,000 data sets, of which 0.001 may have one: 5 are expected, and more than 13 have a chance of 0.001."""
    phase = np.concatenate([one.time / PERIOD for one in MEASURED] + [np.zeros(1)])
    smooth = 20.0 * np.sin(2.0 * np.pi * phase) + 3.0 * np.cos(6.0 * np.pi * phase)
    assert sum(len(found(noise(seed) + smooth)) for seed in range(5000)) <= 13


@given(st.integers(0, 3), st.integers(0, 99))
@settings(max_examples=50)
def test_an_oscillation_that_the_model_misses_is_no_outlier(number, seed):
    """At a third of the sampling rate it is off the line between its neighbours in most samples, by up to 12 sd."""
    residual = noise(seed)
    own = slice(number * SAMPLES, (number + 1) * SAMPLES)
    growing = np.linspace(0.5, 1.0, SAMPLES)
    residual[own] += 10.0 * growing * np.sin(2.0 * np.pi * np.arange(SAMPLES) / 3.0)
    assert not found(residual)


@given(st.integers(0, 3), st.integers(0, SAMPLES - 1), st.sampled_from((-1.0, 1.0)), st.integers(0, 99))
@settings(max_examples=100)
def test_an_added_outlier_is_found(number, sample, sign, seed):
    residual = noise(seed)
    residual[number * SAMPLES + sample] += 25.0 * sign
    assert found(residual) == {(CONDITIONS[number], MEASURED[number].time[sample], sign)}


def test_a_step_is_not_an_outlier():
    """What lasts is not an artefact."""
    residual = np.zeros(ROWS)
    residual[20:40] = 6.0
    assert not found(residual)


def test_simultaneous_outliers_of_several_series_are_attributed_to_the_model():
    residual = noise(1)
    residual[[12, SAMPLES + 12, 2 * SAMPLES + 12]] += 20.0
    assert not found(residual)
    residual[[SAMPLES + 12, 2 * SAMPLES + 12]] -= 20.0
    assert len(found(residual)) == 1


def test_outliers_that_are_simultaneous_by_chance_are_left_out():
    """One per cent of 24 waveforms of 60 samples: of 14 on average, a few have others within a sample and a half."""
    many = [waveform((np.arange(60) + 0.5) / 60 * PERIOD, PERIOD, f"condition {k}") for k in range(24)]
    problem, kept, trials = series_problem(many), 0, 100
    for seed in range(trials):
        random = np.random.default_rng(seed)
        off = random.random(24 * 60) < 0.01
        residual = random.standard_normal(24 * 60) + 20.0 * off * random.choice([-1.0, 1.0], 24 * 60)
        kept += len(find_outliers(problem, residual)) < off.sum()
    assert kept <= 10, "the chance of a coincidence, 0.05, and its error of five trials"


def test_a_mean_is_not_a_sample():
    residual = np.zeros(ROWS)
    residual[-1] = 50.0
    assert not found(residual)
