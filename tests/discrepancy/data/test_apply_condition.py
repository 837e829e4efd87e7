"""The network under a condition: values, drives and period."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition, drive_paths, read_conditions
from coronaryuq.zerod.network.period import period_of


def test_a_condition_scales_arterioles_and_period():
    network = left_coronary()
    changed = apply_condition(network, Condition("x", coronary_resistance_scale=0.25, period_scale=0.5))
    old, new = (n["boundary_conditions"][1]["bc_values"] for n in (network, changed))
    assert new["Ra1"] == pytest.approx(0.25 * old["Ra1"]) and new["Rv1"] == old["Rv1"]
    assert new["t"][-1] == pytest.approx(0.5 * old["t"][-1])


def test_the_value_of_a_bed_is_kept_if_an_effect_changes_its_type():
    """So that the `conditions.yaml` of a result can be searched again."""
    network, condition = left_coronary(), Condition("x", set={"BC_lad": {"Ra2": 5.0, "Ra1": 2.0}})
    bed = next(b for b in network["boundary_conditions"] if b["bc_name"] == "BC_lad")
    bed["bc_type"], values = "CORONARY_VAR_RES", bed["bc_values"]
    values["Ra2_min"] = values["Ra2_max"] = values.pop("Ra2")
    changed = apply_condition(network, condition)
    changed = next(b for b in changed["boundary_conditions"] if b["bc_name"] == "BC_lad")["bc_values"]
    assert (changed["Ra1"], changed["Ra2_min"], changed["Ra2_max"]) == (2.0, 5.0, 5.0)


@pytest.fixture
def ventricle(tmp_path):
    def of(length):
        time = np.linspace(0.0, length, 50)
        pd.DataFrame({"t": time, "value": 60.0 - 50.0 * np.cos(2 * np.pi * time / length)}).to_csv(
            tmp_path / "lv.csv", index=False
        )
        (tmp_path / "conditions.yaml").write_text("rest: {drive: {LV: lv.csv}}")
        return read_conditions(tmp_path / "conditions.yaml")["rest"]

    return of


def test_a_ventricular_pressure_does_not_set_the_period(ventricle, tmp_path):
    """A beat one sample short is stretched to that of the network; a different beat is rejected."""
    network = left_coronary()
    assert period_of(apply_condition(network, ventricle(0.99 * PERIOD))) == period_of(network)
    with pytest.raises(InputError, match="drive.LV"):
        apply_condition(network, ventricle(0.8 * PERIOD))
    assert drive_paths(tmp_path / "conditions.yaml") == [tmp_path / "lv.csv"]


@pytest.mark.parametrize(("key", "expected"), [("set", 3.0), ("scale", 0.0)])
def test_an_omitted_value_of_a_vessel_is_zero(key, expected):
    network = left_coronary()
    values = next(v for v in network["vessels"] if v["vessel_name"] == "lad")["zero_d_element_values"]
    values.pop("stenosis_coefficient", None)
    changed = apply_condition(network, Condition("rest", **{key: {"lad": {"stenosis_coefficient": 3.0}}}))
    vessel = next(v for v in changed["vessels"] if v["vessel_name"] == "lad")
    assert vessel["zero_d_element_values"]["stenosis_coefficient"] == expected
    for block, name in (("lad", "roughness"), ("BC_lad", "stenosis_coefficient")):
        with pytest.raises(InputError, match=name):
            apply_condition(network, Condition("rest", **{key: {block: {name: 3.0}}}))


def test_a_block_named_as_a_covariate_is_rejected():
    network = left_coronary()
    network["boundary_conditions"][0]["bc_name"] = "LV"
    network["vessels"][0]["boundary_conditions"]["inlet"] = "LV"
    wave = (np.linspace(0.0, PERIOD, 9), np.ones(9))
    with pytest.raises(InputError, match=r"rest\.drive\.LV: .*rename that block"):
        apply_condition(network, Condition("rest", drive={"LV": wave}))


def test_a_flag_cannot_be_scaled():
    network = left_coronary()
    network["boundary_conditions"][1]["bc_values"]["closed_loop_outlet"] = True
    with pytest.raises(InputError) as caught:
        apply_condition(network, Condition("rest", scale={"BC_lad": {"closed_loop_outlet": 2.0}}))
    assert "known: Ra1" in str(caught.value) and "closed_loop_outlet," not in str(caught.value)


def test_a_drive_in_a_different_unit_is_rejected():
    time = np.linspace(0.0, PERIOD, 9)
    with pytest.raises(InputError, match=r"rest\.drive\.AORTA: mean over the network's own = 0\.000\d+: use"):
        apply_condition(left_coronary(), Condition("rest", drive={"AORTA": (time, np.full(9, 90.0))}))


def test_a_flow_that_drives_in_another_unit_is_rejected():
    network = left_coronary()
    (drive,) = (block for block in network["boundary_conditions"] if block["bc_name"] == "AORTA")
    flow = np.full(len(drive["bc_values"]["t"]), 3.0)
    drive.update(bc_type="FLOW", bc_values={"t": drive["bc_values"]["t"], "Q": flow.tolist()})
    time = np.linspace(0.0, PERIOD, 9)
    with pytest.raises(InputError, match=r"rest\.drive\.AORTA: mean over the network's own = 60\.0: use .* flow"):
        apply_condition(network, Condition("rest", drive={"AORTA": (time, np.full(9, 180.0))}))


def test_a_drive_with_times_in_ms_is_rejected():
    time = np.linspace(0.0, 1e3 * PERIOD, 9)
    with pytest.raises(InputError, match=r"rest\.drive\.AORTA: length \(s\) = .*give t in s"):
        apply_condition(left_coronary(), Condition("rest", drive={"AORTA": (time, np.full(9, 1.2e5))}))


def test_an_unknown_block_is_answered_with_similar_ones():
    with pytest.raises(InputError, match="no such block in the network; similar: .*lad"):
        apply_condition(left_coronary(), Condition("rest", scale={"LADD".lower(): {"L": 2.0}}))
