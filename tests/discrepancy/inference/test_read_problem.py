"""A problem is read from files; measurements that the model cannot explain at all are rejected."""

import numpy as np
import pandas as pd
import pytest
import yaml

from coronaryuq.cli import main
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.network.read import read_network


def test_an_absurd_value_is_rejected(error_of):
    def change(table):
        table.loc[7, "value"] = 1e30
        return table

    message = error_of(change)
    assert "rest/flow/AORTA:left_main/waveform, t = " in message and "check the value and its unit" in message


@pytest.mark.parametrize(("quantity", "factor"), [("flow", 30.0), ("flow", 1 / 60), ("pressure", 7.5)])
def test_values_in_another_unit_than_stated_are_rejected(error_of, quantity, factor):
    """The hidden stenosis and the beds, which are off, change the flow by less than a factor of two."""
    message = error_of(lambda t: t.assign(value=np.where(t.quantity == quantity, factor * t.value, t.value)))
    _assert_another_unit(message, factor)


def _assert_another_unit(message, factor):
    told, _, rest = message.partition(": ratio of measured to simulated values = ")[2].partition(":")
    assert 0.5 < float(told) / factor < 2.0 and rest.startswith(" check the column unit, and the unit of the model (")


@pytest.mark.parametrize("factor", [7.5, 1 / 7.5])
def test_one_pressure_in_another_unit_is_rejected(error_of, factor):
    """One in kPa had been something else, with a gain of -0.87, after 156 s."""
    place = "lad:BC_lad"
    message = error_of(lambda t: t.assign(value=np.where(t.location == place, factor * t.value, t.value)))
    assert f"pressure at {place} under rest: " in message
    _assert_another_unit(message, factor)


@pytest.mark.parametrize("factor", [50 / 3, 3 / 50])
def test_flows_of_one_condition_in_another_unit_are_rejected(error_of, factor):
    """L/min, stated as mL/s or the reverse, had been something else, after 61 s."""

    def change(table):
        wrong = (table.quantity == "flow") & (table.condition == "hyperaemia")
        return table.assign(value=np.where(wrong, factor * table.value, table.value))

    message = error_of(change)
    assert "flow under hyperaemia: " in message
    _assert_another_unit(message, factor)


def test_flows_of_opposite_sign_are_rejected(error_of):
    def turned(table):
        return table.assign(value=np.where(table.quantity == "flow", -table.value, table.value))

    message = error_of(turned)
    assert "mean flow (mL/s) = -" in message and "check the sign convention" in message


def test_a_network_in_another_unit_than_detected_is_rejected(stenosis_case, tmp_path, capsys):
    folder = stenosis_case[0]
    network = read_network(folder / "model.json")
    for block in network["boundary_conditions"]:
        for name in ("P", "Pim", "P_v", "Pd"):
            if name in block["bc_values"]:
                block["bc_values"][name] = (np.asarray(block["bc_values"][name]) / 10.0).tolist()
    write_json(tmp_path / "model.json", network)
    words = ["--model", tmp_path / "model.json", "--measurements", folder / "measurements.csv"]
    words += ["--conditions", folder / "conditions.yaml", "--out", tmp_path / "out"]
    assert main.main(["discrepancy", *map(str, words)]) == InputError.EXIT_CODE
    line = capsys.readouterr().err
    assert (
        f"{tmp_path / 'model.json'}: mean root pressure (mmHg) = " in line
        and "assuming dyn/cm2 in all R" in line
        and line.count("\n") == 1
    )


def _in_the_lcx(table):
    return (table.quantity == "flow") & (table.location == "lcx:BC_lcx")


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.assign(value=np.where(_in_the_lcx(t), 1e-3 * t.value, t.value)),
        lambda t: t.assign(value=np.where((t.quantity == "perfusion") & (t.condition == "rest"), 0.0, t.value)),
        lambda t: t.assign(value=np.where(t.quantity == "pressure", 0.22 * t.value, t.value)),
    ],
    ids=["a vessel all but closed", "a bed without perfusion at rest", "behind a tight stenosis"],
)
def test_extreme_but_possible_measurements_are_accepted(stenosis_case, tmp_path, change):
    folder = stenosis_case[0]
    change(pd.read_csv(folder / "measurements.csv")).to_csv(tmp_path / "m.csv", index=False)
    conditions = read_conditions(folder / "conditions.yaml")
    problem = read_problem(read_network(folder / "model.json"), tmp_path / "m.csv", conditions, "c", Settings())
    assert np.isfinite(problem.y).all()


@pytest.mark.parametrize(("factor", "said"), [(-1.0, "opposite to"), (0.06, "0.0"), (1.0, None)])
def test_a_flow_of_another_sign_or_unit_than_the_model_is_noted(stenosis_case, tmp_path, factor, said):
    """It is not refused: what is missing may have stopped or reversed it."""
    folder, lines = stenosis_case[0], []
    table, conditions = pd.read_csv(folder / "measurements.csv"), read_conditions(folder / "conditions.yaml")
    changed = table.assign(value=np.where(_in_the_lcx(table), factor * table.value, table.value))
    changed.to_csv(tmp_path / "m.csv", index=False)
    network = read_network(folder / "model.json")
    read_problem(network, tmp_path / "m.csv", conditions, "c", Settings(), lines.append)
    own = [f"{name}/flow/lcx:BC_lcx: mean {said}" for name in table[_in_the_lcx(table)].condition.unique() if said]
    assert len(lines) == len(own)
    for line, start in zip(lines, own, strict=True):
        assert line.startswith(f"note: {tmp_path / 'm.csv'}: {start}") and line.endswith("check its sign and unit")


def test_means_that_set_a_free_parameter_cannot_also_verify_it(stenosis_case, tmp_path):
    folder = stenosis_case[0]
    table = pd.read_csv(folder / "measurements.csv")
    table[table.statistic == "mean"].to_csv(tmp_path / "m.csv", index=False)
    content = yaml.safe_load((folder / "conditions.yaml").read_text())
    for name, entry in content.items():
        content[name] = entry | ({"free": ["coronary_resistance_scale"]} if entry.get("held_out") else {})
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match="nothing remains for validation"):
        read_problem(
            read_network(folder / "model.json"),
            tmp_path / "m.csv",
            read_conditions(tmp_path / "c.yaml"),
            tmp_path / "c.yaml",
            Settings(),
        )
