"""A conditions file says what a condition is, or one line says what is wrong with it."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.conditions import Condition, drive_files, drives_of, period_of, read_conditions, under
from coronaryuq.discrepancy.data.measurements import _table


def read(tmp_path, text):
    (tmp_path / "conditions.yaml").write_text(text)
    return read_conditions(tmp_path / "conditions.yaml")["rest"]


@pytest.mark.parametrize("free", ["coronary_resistance_scale", "[coronary_resistance_scale]"])
def test_what_is_free_is_a_list_or_one_of_it(tmp_path, free):
    assert read(tmp_path, f"rest: {{free: {free}}}").free == ("coronary_resistance_scale",)


@pytest.mark.parametrize("free", ["1", "true", "{bed_shape: 1}", "[pressure]", "pressure"])
def test_what_cannot_be_free(tmp_path, free):
    with pytest.raises(InputError, match="rest.free"):
        read(tmp_path, f"rest: {{free: {free}}}")


@pytest.fixture
def ventricle(tmp_path):
    def of(length):
        time = np.linspace(0.0, length, 50)
        pd.DataFrame({"t": time, "value": 60.0 - 50.0 * np.cos(2 * np.pi * time / length)}).to_csv(
            tmp_path / "lv.csv", index=False
        )
        return read(tmp_path, "rest: {drive: {LV: lv.csv}}")

    return of


def test_a_ventricular_pressure_sets_no_period(ventricle, tmp_path):
    """It drives nothing: a beat cut one sample short is stretched to the network's, another beat is none of its."""
    network = left_coronary()
    assert period_of(under(network, ventricle(0.99 * PERIOD))) == period_of(network)
    with pytest.raises(InputError, match="drive.LV"):
        under(network, ventricle(0.8 * PERIOD))
    assert drives_of(tmp_path / "conditions.yaml") == [tmp_path / "lv.csv"]


@pytest.mark.parametrize(("key", "expected"), [("set", 3.0), ("scale", 0.0)])
def test_a_number_that_the_vessel_leaves_out_is_nought(key, expected):
    network = left_coronary()
    values = next(v for v in network["vessels"] if v["vessel_name"] == "lad")["zero_d_element_values"]
    values.pop("stenosis_coefficient", None)
    changed = under(network, Condition("rest", **{key: {"lad": {"stenosis_coefficient": 3.0}}}))
    vessel = next(v for v in changed["vessels"] if v["vessel_name"] == "lad")
    assert vessel["zero_d_element_values"]["stenosis_coefficient"] == expected
    for block, name in (("lad", "roughness"), ("BC_lad", "stenosis_coefficient")):
        with pytest.raises(InputError, match=name):
            under(network, Condition("rest", **{key: {block: {name: 3.0}}}))


def test_a_condition_may_be_called_by_digits(tmp_path):
    rows = ["condition,quantity,location,statistic,time,value,sd,unit", "01,flow,A:B,mean,,1.0,0.1,mL/s"]
    (tmp_path / "measurements.csv").write_text("\n".join(rows) + "\n")
    table = _table(tmp_path / "measurements.csv")
    assert table["condition"].tolist() == ["01"] and table["value"].tolist() == [1.0]


def test_every_drive_has_a_file_of_its_own():
    """Also where case does not count, and in no other folder."""
    wanted = [
        ("low dose", "A"),
        ("low_dose", "A"),
        ("a", "b_c"),
        ("a_b", "c"),
        ("A_b", "c"),
        ("../up", "A"),
        ("x", "y"),
    ]
    found = drive_files(wanted)
    assert list(found) == wanted
    assert len({name.lower() for name in found.values()}) == len(wanted)
    assert all(name.count("/") == 1 and ".." not in name for name in found.values())
    assert found["x", "y"] == "drives/x_y.csv"


def test_a_block_called_as_a_measured_waveform_is():
    network = left_coronary()
    network["boundary_conditions"][0]["bc_name"] = "LV"
    network["vessels"][0]["boundary_conditions"]["inlet"] = "LV"
    wave = (np.linspace(0.0, PERIOD, 9), np.ones(9))
    with pytest.raises(InputError, match=r"rest\.drive\.LV: .*name that block otherwise"):
        under(network, Condition("rest", drive={"LV": wave}))


def test_a_flag_is_no_number_to_scale():
    network = left_coronary()
    network["boundary_conditions"][1]["bc_values"]["closed_loop_outlet"] = True
    with pytest.raises(InputError) as caught:
        under(network, Condition("rest", scale={"BC_lad": {"closed_loop_outlet": 2.0}}))
    assert "know Ra1" in str(caught.value) and "closed_loop_outlet," not in str(caught.value)


@pytest.mark.parametrize("scale", [30.0, 0.01])
def test_a_factor_that_is_a_percentage(tmp_path, scale):
    with pytest.raises(InputError, match="a factor, 0.05 to 20; 0.3 for 30 %"):
        read(tmp_path, f"rest: {{coronary_resistance_scale: {scale}}}")


def test_a_drive_in_another_unit_than_the_network():
    time = np.linspace(0.0, PERIOD, 9)
    with pytest.raises(InputError, match=r"rest\.drive\.AORTA = 0\.000\d+: times the network's own"):
        under(left_coronary(), Condition("rest", drive={"AORTA": (time, np.full(9, 90.0))}))


def test_a_number_that_no_machine_holds(tmp_path):
    with pytest.raises(InputError, match="want a number"):
        read(tmp_path, f"rest: {{period_scale: {'9' * 400}}}")


@pytest.mark.parametrize("name", ["'#1'", "' rest'", '"re\\nst"'])
def test_a_condition_whose_name_no_table_holds(tmp_path, name):
    with pytest.raises(InputError, match="not a condition's name"):
        read(tmp_path, f"{name}:\nrest:\n")


def test_one_value_is_no_beat():
    """A constant says nothing of the period, whatever time it is given for."""
    network = left_coronary()
    for block in network["boundary_conditions"]:
        for name in ("P", "Pim"):
            if name in block["bc_values"]:
                block["bc_values"] |= {name: block["bc_values"][name][:1], "t": [0.0]}
    assert period_of(network) == 1.0
    network["simulation_parameters"]["cardiac_period"] = 0.7
    assert period_of(network) == 0.7


def test_a_block_that_is_not_there_is_answered_with_those_near():
    with pytest.raises(InputError, match="no such block; near: .*lad"):
        under(left_coronary(), Condition("rest", scale={"LADD".lower(): {"L": 2.0}}))
