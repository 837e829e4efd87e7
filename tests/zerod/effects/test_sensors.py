"""Tests of offsets, drifts, saturation and places of probes."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.library import effect

CONDITIONS = ("rest", "hyperaemia", "pacing")


def means(quantity, place, scale=4.0):
    return [Series(condition, quantity, place, "mean", None, 1.0, scale=scale) for condition in CONDITIONS]


@pytest.mark.parametrize(("quantity", "name"), [("flow", "flow"), ("pressure", "pressure")])
def test_a_drift_grows_evenly_over_the_conditions_and_an_offset_does_not(quantity, name):
    series = [*means(quantity, "a:b"), *means(quantity, "b:c")]
    predicted = [np.array([[value]]) for value in (2.0, 6.0, 4.0, 1.0, 1.0, 1.0)]
    read = np.ravel(effect(f"{name}_drift").observe("a:b", {"drift": np.array([0.1])}, series, predicted))
    assert read == pytest.approx([2.0, 6.2, 4.4, 1.0, 1.0, 1.0])
    read = np.ravel(effect(f"{name}_offset").observe("a:b", {"offset": np.array([0.1])}, series, predicted))
    assert read == pytest.approx([2.4, 6.4, 4.4, 1.0, 1.0, 1.0])
    backward = [-value for value in predicted]
    read = np.ravel(effect(f"{name}_offset").observe("a:b", {"offset": np.array([0.1])}, series, backward))
    assert read == pytest.approx([-1.6, -5.6, -3.6, -1.0, -1.0, -1.0])
    assert effect(f"{name}_drift").places(None, series) == ["a:b", "b:c"]
    assert effect(f"{name}_drift").places(None, series[:1]) == []


def test_a_saturating_meter_loses_more_of_a_high_flow_in_both_directions():
    anatomy = Anatomy(left_coronary(), 1.2e5, {"lcx": 0.5, "left_main": 2.0})
    one, sizes = effect("flow_saturation"), {"saturation": np.array([0.1])}
    flow, wave = means("flow", "lcx:BC_lcx")[0], np.array([[-0.5, 0.0, 0.5, 2.0]])
    assert one.read("lcx:BC_lcx", sizes, flow, wave, None, anatomy)[0] == pytest.approx(
        [-0.5 / 1.1, 0.0, 0.5 / 1.1, 2.0 / 1.4]
    )
    assert one.read("J0:lcx", sizes, flow, wave, None, anatomy) is wave
    assert one.read("lcx:BC_lcx", {"saturation": np.zeros(1)}, flow, wave, None, anatomy)[0] == pytest.approx(wave[0])
    assert one.places(anatomy, means("flow", "lcx:BC_lcx") + means("pressure", "J0:lcx")) == ["lcx:BC_lcx"]


def test_a_misplaced_probe_has_the_vessels_that_meet_its_own_as_places():
    anatomy = Anatomy(left_coronary())
    flow, pressure = means("flow", "J0:lad_proximal"), means("pressure", "lad_proximal:J1")
    places = effect("misplaced_flow").places(anatomy, flow)
    assert {place.rpartition(" towards ")[2] for place in places} == {"left_main", "lcx", "lad", "diagonal"}
    places = effect("misplaced_pressure").places(anatomy, pressure)
    assert {place.rpartition(" towards ")[2] for place in places} == {"lad_proximal", "lad", "diagonal"}
    # A pressure in the heart has no neighbouring vessel.
    assert effect("misplaced_pressure").places(anatomy, means("pressure", "P_LV:CLH")) == []


def test_every_pair_of_one_quantity_may_be_exchanged():
    series = [*means("flow", "a:b"), *means("flow", "b:c"), *means("flow", "c:d"), *means("pressure", "a:b")]
    assert effect("exchanged_flows").places(None, series) == ["a:b and b:c", "a:b and c:d", "b:c and c:d"]
    assert effect("exchanged_pressures").places(None, series) == []
    assert effect("flow_crosstalk").places(None, series)[:3] == ["a:b with b:c", "a:b with c:d", "b:c with a:b"]
