"""Clinical measures on waveforms whose values are known by integration."""

import numpy as np
import pytest

from coronaryuq.zerod.cardiac_function import MEASURES, measure, open_interval, turning_points, waveform_names
from coronaryuq.zerod.network.read import read_network

PERIOD = 0.8
TIME = np.linspace(0.0, PERIOD, 801)
EJECTION = (0.1, 0.4)
"""s; aortic valve flow is half a sine between these times."""


def half_sine(start, end, volume, time=TIME):
    """Flow of a given volume (mL) that passes as half a sine between two times."""
    phase = (time - start) / (end - start)
    return np.where((phase > 0) & (phase < 1), np.sin(np.pi * phase), 0.0) * volume * np.pi / (2 * (end - start))


def beat(shift=0.0):
    """Waveforms of one sample, all known in closed form, shifted in time by whole steps."""
    steps = round(shift / (TIME[1] - TIME[0]))

    def moved(wave):
        return np.append(np.roll(wave[:-1], steps), np.roll(wave[:-1], steps)[0])[None]

    ejected = half_sine(*EJECTION, 70.0)
    begins, ends = EJECTION
    systole = (begins < TIME) & (ends > TIME)
    left = np.where(systole, 1.0, 3.0)
    return {
        "aortic_pressure": moved(100.0 + 20.0 * np.sin(2 * np.pi * TIME / PERIOD)),
        "aortic_flow": moved(ejected),
        "right_atrial_pressure": moved(np.full_like(TIME, 4.0)),
        "pulmonary_pressure": moved(14.0 + np.cos(2 * np.pi * TIME / PERIOD)),
        "lv_volume": moved(90.0 + 35.0 * np.cos(2 * np.pi * TIME / PERIOD)),
        "aortic_valve": moved(ejected),
        "mitral_valve": moved(half_sine(0.45, 0.6, 45.0) + half_sine(0.65, 0.79, 20.0)),
        "pulmonary_valve": moved(half_sine(0.1, 0.42, 70.0)),
        "left_coronary": moved(left),
        "right_coronary": moved(np.full_like(TIME, 1.0)),
        "systemic": moved(np.full_like(TIME, 83.5)),
    }


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5])
def test_measures_of_a_beat_in_closed_form(shift):
    values = {name: value[0] for name, value in measure(TIME, beat(shift)).items()}
    systole = EJECTION[1] - EJECTION[0]
    assert (values["PaoMin"], values["PaoMax"]) == pytest.approx((80.0, 120.0), rel=1e-6)
    assert values["PaoMean"] == pytest.approx(100.0, rel=1e-9)
    assert values["AbsQin"] == pytest.approx(70.0, rel=1e-4)
    assert (values["EDV"], values["ESV"]) == pytest.approx((125.0, 55.0))
    assert values["EFLV"] == pytest.approx(0.56)
    assert values["PpulMean"] == pytest.approx(14.0)
    assert values["PraMean"] == pytest.approx(4.0)
    assert values["Qsystole_perc"] == pytest.approx(1.0, abs=1e-3)
    assert values["aorValveTime"] == pytest.approx(systole / PERIOD, abs=0.005)
    assert values["mitValveTime"] == pytest.approx((0.15 + 0.14) / PERIOD, abs=0.005)
    assert values["pulValveTime"] == pytest.approx(0.32 / PERIOD, abs=0.005)
    assert values["QlaRatio"] == pytest.approx((45.0 / 0.15) / (20.0 / 0.14), rel=1e-3)
    # left: 1 mL/s for 0.3 s of systole, 3 mL/s for 0.5 s of diastole
    assert values["LCorTotRatio"] == pytest.approx(1.5 / 0.3, rel=0.02)
    assert values["LCorMaxRatio"] == pytest.approx(3.0, rel=0.35)  # the step lies on a systolic edge
    assert values["LThirdFF"] == pytest.approx(3.0 * PERIOD / 3 / 1.8, rel=0.01)
    assert values["LHalfFF"] == pytest.approx(3.0 * PERIOD / 2 / 1.8, rel=0.01)
    assert values["RCorTotRatio"] == pytest.approx(0.5 / 0.3, rel=0.02)
    assert values["RCorMaxRatio"] == pytest.approx(1.0)
    mean_left = 1.8 / PERIOD
    assert values["AorCorSplit"] == pytest.approx(100 * (mean_left + 1) / (mean_left + 1 + 83.5), rel=0.002)


def test_every_measure_is_given_for_every_sample_of_a_batch():
    one, two = beat(), beat(0.3)
    waves = {role: np.vstack([one[role], two[role], one[role]]) for role in one}
    values = measure(TIME, waves)
    assert set(values) == set(MEASURES)
    for name, value in values.items():
        assert value.shape == (3,)
        assert value[0] == value[2], name
        assert np.isfinite(value).all(), name


def test_measures_change_smoothly_with_the_parameters():
    """A closing time that moves by a fraction of a step moves the measures by about that fraction: no staircase."""
    fractions = []
    for nudge in np.linspace(0.0, 1e-3, 11):
        waves = beat()
        waves["aortic_valve"] = half_sine(EJECTION[0], EJECTION[1] + nudge, 70.0)[None]
        waves["left_coronary"] = (2.0 - np.sin(2 * np.pi * TIME / PERIOD))[None]
        fractions.append(measure(TIME, waves)["LThirdFF"][0])
    steps = np.diff(fractions)
    assert np.ptp(steps) < 0.5 * np.abs(steps).max()


def test_a_valve_that_never_opens_leaves_its_measures_empty():
    waves = beat()
    waves["aortic_valve"] = np.zeros_like(waves["aortic_valve"])
    values = measure(TIME, waves)
    assert np.isnan(values["aorValveTime"][0]) and np.isnan(values["LThirdFF"][0])
    assert values["PaoMean"][0] == pytest.approx(100.0)


def test_systole_may_pass_the_end_of_the_cycle():
    flow = np.append(np.roll(half_sine(*EJECTION, 70.0)[:-1], -300), 0.0)
    flow[-1] = flow[0]
    start, end = open_interval(TIME, flow)
    assert end - start == pytest.approx(EJECTION[1] - EJECTION[0], abs=0.004)
    assert start == pytest.approx((EJECTION[0] - 0.3) % PERIOD, abs=0.003)


def test_a_valve_that_flutters_does_not_end_systole():
    flow = half_sine(*EJECTION, 70.0)
    flow[(TIME > 0.3) & (TIME < 0.3 + 0.05 * PERIOD)] = 0.0
    start, end = open_interval(TIME, flow)
    assert (start, end) == pytest.approx(EJECTION, abs=0.004)
    flow[(TIME > 0.25) & (TIME < 0.25 + 0.1 * PERIOD)] = 0.0
    assert open_interval(TIME, flow)[1] == pytest.approx(0.25, abs=0.004)


def test_recoil_after_closure_is_no_systole():
    flow = half_sine(*EJECTION, 70.0)
    flow = flow + half_sine(0.41, 0.44, 0.03 * flow.max() * 0.03)
    assert open_interval(TIME, flow) == pytest.approx(EJECTION, abs=0.004)


@pytest.mark.parametrize(
    "wave, score",
    [
        (lambda phase: -np.sin(2 * np.pi * phase) - 1.5 * np.sin(4 * np.pi * phase), 5.0),  # two of each, falling first
        (lambda phase: np.sin(2 * np.pi * phase), 2.0),  # one peak, one valley, the peak first
        (lambda phase: -np.sin(2 * np.pi * phase), 3.0),
        (lambda phase: 0.0 * phase, 0.0),
    ],
)
def test_turning_points_score_the_shape(wave, score):
    flow = wave(TIME / PERIOD)
    flow[-1] = flow[0]
    assert turning_points(flow) == score


def test_ripples_below_the_prominence_do_not_count():
    phase = TIME / PERIOD
    assert turning_points(-np.sin(2 * np.pi * phase) + 0.01 * np.sin(40 * np.pi * phase)) == 3.0


def test_names_follow_the_network(shared):

    network = read_network(shared / "data/closed-loop-22/svzerod_tuning_cgs.json")
    roles = waveform_names(network)
    assert len(roles["left_coronary"]) == 12 and len(roles["right_coronary"]) == 10 and len(roles["systemic"]) == 5
    assert roles["aortic_pressure"] == ["pressure:J_heart_outlet:aorta"]
    assert "flow:lca1:BC_lca1" in roles["left_coronary"]
