"""Tests of filters of the measuring chain: each is the response of its differential equation to a periodic beat."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.library import LIBRARY, effect
from coronaryuq.zerod.effects.measuring_chain import LinearFilter
from support.zerod_networks import bifurcation

PERIOD, POINTS = 0.8, 300
FILTERS = [one for one in LIBRARY if isinstance(one, LinearFilter)]
TIME = np.arange(POINTS) / POINTS * PERIOD


def series(quantity="pressure", place="a:b", statistic="waveform"):
    return Series("rest", quantity, place, statistic, TIME if statistic == "waveform" else None, PERIOD)


def beat(time):
    """Return a smooth waveform of 40 harmonics of the beat."""
    phase = 2.0 * np.pi * time / PERIOD
    return 90.0 + 20.0 * np.exp(3.0 * (np.cos(phase - 1.0) - 1.0)) + 3.0 * np.sin(5.0 * phase)


def read(name, place="a:b", wave=None, quantity=None, **sizes):
    one = effect(name)
    quantity = quantity or one.quantities[0]
    wave = beat(TIME) if wave is None else wave
    arrays = {key: np.array([value]) for key, value in sizes.items()}
    return one.read(place, arrays, series(quantity), wave[None, :], None, Anatomy(bifurcation()))[0]


@pytest.mark.parametrize("name", ["pressure_low_pass", "flow_low_pass"])
def test_a_low_pass_solves_its_differential_equation(name):
    """After ten time constants the transient of the integrated equation is gone."""
    tau = 0.03
    exact = solve_ivp(
        lambda time, y: (beat(time) - y) / tau, (0.0, 3 * PERIOD), [90.0], "LSODA", rtol=1e-9, t_eval=2 * PERIOD + TIME
    )
    assert read(name, time_constant=tau) == pytest.approx(exact.y[0], abs=1e-5)


def test_a_catheter_solves_the_equation_of_a_damped_oscillator():
    period, damping = 1.0 / 9.0, 0.25
    omega = 2.0 * np.pi / period

    def rates(time, y):
        return [y[1], omega**2 * (beat(time) - y[0]) - 2.0 * damping * omega * y[1]]

    exact = solve_ivp(rates, (0.0, 4 * PERIOD), [90.0, 0.0], "LSODA", rtol=1e-9, atol=1e-9, t_eval=3 * PERIOD + TIME)
    ringing = read("catheter_resonance", natural_period=period, damping=damping)
    assert ringing == pytest.approx(exact.y[0], abs=1e-4)
    assert np.ptp(ringing) > np.ptp(beat(TIME))


@pytest.mark.parametrize("one", FILTERS, ids=lambda one: one.name)
@given(z=st.floats(-2.0, 2.0), seed=st.integers(0, 99))
def test_a_filter_keeps_the_mean_and_is_linear(one, z, seed):
    first, second = np.random.default_rng(seed).normal(size=(2, POINTS))
    sizes = {parameter.name: float(parameter.from_standard(z)) for parameter in one.parameters}

    def filtered(wave):
        return read(one.name, wave=wave, **sizes)

    assert filtered(first).mean() == pytest.approx(first.mean(), abs=1e-12)
    assert filtered(first - 2.0 * second) == pytest.approx(filtered(first) - 2.0 * filtered(second), abs=1e-9)


@pytest.mark.parametrize("one", FILTERS, ids=lambda one: one.name)
def test_a_vanishing_filter_reads_the_waveform_itself(one):
    sizes = {parameter.name: 1e-9 for parameter in one.parameters}
    assert read(one.name, **sizes) == pytest.approx(beat(TIME), rel=1e-6)


def test_a_filter_acts_on_its_own_waveform_only():
    wave, sizes = beat(TIME)[None, :], {"time_constant": np.array([0.02])}
    for other in (series("flow"), series(place="b:c"), series(statistic="mean")):
        assert effect("pressure_low_pass").read("a:b", sizes, other, wave, None, None) is wave
    low_pass = effect("flow_low_pass")
    assert low_pass.read("every flow", sizes, series("pressure"), wave, None, None) is wave
    assert low_pass.read("every flow", sizes, series("flow", "b:c"), wave, None, None) is not wave
    assert low_pass.read("a:b", sizes, series("flow", statistic="max"), wave, None, None) is not wave


def test_one_device_that_reads_several_waveforms_is_a_place():
    flows = [series("flow", place) for place in ("a:b", "b:c")]
    assert effect("flow_low_pass").places(None, flows) == ["a:b", "b:c", "every flow"]
    assert effect("flow_low_pass").places(None, flows[:1]) == ["a:b"]
    mean = series("pressure", "b:c", "mean")
    assert effect("catheter_resonance").places(None, [*flows, series(), mean]) == ["a:b"]
    assert effect("flow_delay").places(None, flows) == ["a:b", "b:c"]


def test_a_sensor_delay_shifts_only_its_own_waveform():
    every = [series(quantity, place) for quantity in ("pressure", "flow") for place in ("a:b", "b:c")]
    every += [series("flow", statistic=statistic) for statistic in ("mean", "max")]
    sizes = {"delay": np.array([0.1])}
    late = [float(effect("pressure_delay").delay("a:b", sizes, one)[0]) for one in every]
    assert late == [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    late = [float(effect("flow_delay").delay("a:b", sizes, one)[0]) for one in every]
    assert late == [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]


def test_a_trigger_delay_shifts_all_waveforms_of_its_place():
    trigger, sizes = effect("trigger_delay"), {"delay": np.array([0.1])}
    flows = [series("flow", place) for place in ("a:b", "b:c")]
    mean = series("pressure", "b:c", "mean")
    every = [*flows, series(), mean]
    assert trigger.places(None, every) == ["every waveform", "every flow"]
    late = {
        place: [float(trigger.delay(place, sizes, one)[0]) for one in every] for place in trigger.places(None, every)
    }
    assert late == {"every waveform": [0.1, 0.1, 0.1, 0.0], "every flow": [0.1, 0.1, 0.0, 0.0]}
    # Neither the delay of a single sensor nor a second name for the same sensors is a place.
    assert trigger.places(None, [flows[0], mean]) == []
    assert trigger.places(None, flows) == ["every flow"]


@given(st.integers(1, 6), st.floats(0.0, 0.12))
def test_a_harmonic_averaged_over_beats_fades_as_its_characteristic_function(harmonic, spread):
    """E cos(2 pi m p (1 + s b)) = cos(2 pi m p) exp(-(2 pi m p s)^2 / 2), for a normal b."""
    phase = np.arange(1200) / 1200
    averaged = read(
        "beat_averaging", "every waveform", np.cos(2 * np.pi * harmonic * phase), "flow", period_spread=spread
    )
    fading = np.exp(-0.5 * (2 * np.pi * harmonic * phase * spread) ** 2)
    assert averaged == pytest.approx(np.cos(2 * np.pi * harmonic * phase) * fading, abs=2e-3)


def test_an_average_of_beats_is_one_of_all_waveforms_or_of_all_of_one_quantity():
    average, sizes = effect("beat_averaging"), {"period_spread": np.array([0.05])}
    flows = [series("flow", place) for place in ("a:b", "b:c")]
    assert average.places(None, [*flows, series()]) == ["every waveform", "every flow"]
    wave = beat(TIME)[None, :]
    for one in (series("flow", statistic="mean"), series()):
        assert average.read("every flow", sizes, one, wave, None, None) is wave
    assert average.read("every flow", sizes, flows[1], wave, None, None)[0, 0] == pytest.approx(wave[0, 0])


def test_a_catheter_is_reported_by_its_frequency():
    found = effect("catheter_resonance").physical("a:b", {"natural_period": 0.1, "damping": 0.2}, None)
    assert found == {"natural frequency, Hz": pytest.approx(10.0), "damping ratio": 0.2}
    period, damping = effect("catheter_resonance").parameters
    assert effect("catheter_resonance").describe(period, 0.1, None) == ("natural frequency in Hz", pytest.approx(10.0))
    assert effect("catheter_resonance").describe(damping, 0.2, None) == ("damping ratio", 0.2)


@pytest.mark.parametrize("name", ["pressure_clock_rate", "flow_clock_rate"])
@given(rate=st.floats(-0.1, 0.1))
def test_a_fast_clock_reads_what_was_before_and_a_slow_one_the_next_beat(name, rate):
    """To within the curvature of the waveform between two points."""
    found = read(name, rate=rate)
    assert found == pytest.approx(beat((1.0 - rate) * TIME), abs=0.02)
    assert found[0] == pytest.approx(beat(0.0))


def test_a_clock_is_that_of_one_recording_or_of_all_of_a_quantity():
    anatomy, two = Anatomy(bifurcation()), [series("flow", "a:b"), series("flow", "a:c"), series("pressure", "a:b")]
    clock = effect("flow_clock_rate")
    assert clock.places(anatomy, two) == ["a:b", "a:c", "every flow"]
    assert clock.places(anatomy, two[:1]) == ["a:b"]
    assert [clock.covers("every flow", one) for one in two] == [True, True, False]
    assert [clock.covers("a:c", one) for one in two] == [False, True, False]
