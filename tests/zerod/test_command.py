"""`coronaryuq solve` reads a network and writes svZeroDSolver's table."""

import json
import subprocess
import sys

import pandas as pd
import pytest

from coronaryuq.cli.main import main
from coronaryuq.zerod.svzerodsolver import program
from coronaryuq.zerod.svzerodsolver.tables import simulate
from support.zerod_networks import bifurcation, network, vessel


def test_the_table_is_that_of_simulate(tmp_path):
    (tmp_path / "tree.json").write_text(json.dumps(bifurcation()))
    assert main(["solve", str(tmp_path / "tree.json"), str(tmp_path / "out.csv")]) == 0
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "out.csv"), simulate(bifurcation()), check_exact=True)


def test_a_fault_is_one_line_and_nothing_is_written(tmp_path, capsys):
    tree = bifurcation()
    tree["vessels"][1]["zero_d_element_values"]["Rpoiseuille"] = 1.0
    (tmp_path / "tree.json").write_text(json.dumps(tree))
    assert main(["solve", str(tmp_path / "tree.json"), str(tmp_path / "out.csv")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "vessels.left.zero_d_element_values.Rpoiseuille" in error
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("table", "error"),
    [
        (".", ".: is a folder; name a file in it"),
        ("held", "held: is a folder; name a file in it"),
        ("tree.json/out.csv", "tree.json: expected a folder for results, but tree.json is a file"),
        ("./tree.json", "command line: TABLE.csv = './tree.json': is the network file; choose another file"),
    ],
)
def test_a_table_that_cannot_be_written_is_rejected_before_the_march(tmp_path, monkeypatch, capsys, table, error):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("coronaryuq.zerod.command.simulate", lambda *arguments: pytest.fail("marched"))
    (tmp_path / "held").mkdir()
    (tmp_path / "tree.json").write_text(json.dumps(bifurcation()))
    assert main(["solve", "tree.json", table]) == 1
    assert capsys.readouterr().err == f"error: {error}\n"


def test_a_negative_resistance_is_accepted_with_a_note(tmp_path, capsys):
    tree = bifurcation()
    (tmp_path / "tree.json").write_text(json.dumps(tree))
    assert main(["solve", str(tmp_path / "tree.json"), str(tmp_path / "out.csv")]) == 0
    assert capsys.readouterr().err == ""
    tree["vessels"][1]["zero_d_element_values"]["R_poiseuille"] = -10
    tree["boundary_conditions"][2]["bc_values"]["Rp"] = -5.0
    (tmp_path / "tree.json").write_text(json.dumps(tree))
    assert main(["solve", str(tmp_path / "tree.json"), str(tmp_path / "out.csv")]) == 0
    note = f"note: {tmp_path}/tree.json: left.R_poiseuille = -10: negative resistance (and 1 more)\n"
    assert capsys.readouterr().err == note


def test_without_a_name_the_table_stands_beside_the_network_as_svzerodsolver_puts_it(tmp_path, capsys):
    (tmp_path / "tree.json").write_text(json.dumps(bifurcation()))
    assert main(["solve", str(tmp_path / "tree.json")]) == 0
    assert f"'{tmp_path}/output.csv'" in capsys.readouterr().err
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "output.csv"), simulate(bifurcation()), check_exact=True)


def test_keys_that_svzerodsolver_ignores_are_noted_once(tmp_path, capsys):
    tree = bifurcation() | {"y": {}, "dy": {}}
    for entry in tree["vessels"]:
        entry["vessel_D"] = 0.3
    (tmp_path / "tree.json").write_text(json.dumps(tree))
    assert main(["solve", str(tmp_path / "tree.json"), str(tmp_path / "out.csv")]) == 0
    said = capsys.readouterr().err.splitlines()
    assert said == [
        f"note: {tmp_path}/tree.json: {key}: ignored, as svZeroDSolver does" for key in ("dy", "y", "vessels.vessel_D")
    ]


@pytest.mark.skipif(program.installed() not in program.MODULES, reason="needs svZeroDSolver: pip install svzerod")
@pytest.mark.parametrize("case", ["sound", "wrong", "missing"])
def test_exit_codes_and_columns_are_those_of_svzerodsolver(tmp_path, case):
    tree = bifurcation()
    if case == "wrong":
        del tree["boundary_conditions"][1]["bc_values"]["Rd"]
    if case != "missing":
        (tmp_path / "tree.json").write_text(json.dumps(tree))
    ours, theirs = tmp_path / "ours.csv", tmp_path / "theirs.csv"
    code = f"import {program.installed()} as solver; solver.run_simulation_cli()"
    command = [sys.executable, "-c", code, str(tmp_path / "tree.json"), str(theirs)]
    assert main(["solve", str(tmp_path / "tree.json"), str(ours)]) == subprocess.run(command, check=False).returncode
    assert ours.exists() == theirs.exists() == (case == "sound")
    if case == "sound":
        assert ours.read_text().splitlines()[0] == theirs.read_text().splitlines()[0]


def test_a_run_that_does_not_converge_is_an_error(tmp_path, capsys):
    stiff = network(
        [vessel(0, "tube", inlet="IN", outlet="OUT", R_poiseuille=1.0, L=1.0, stenosis_coefficient=300.0)],
        [
            {"bc_name": "IN", "bc_type": "PRESSURE", "bc_values": {"t": [0.0, 0.5, 1.0], "P": [0.0, 1e5, 0.0]}},
            {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": 1.0, "Pd": 0.0}},
        ],
        steps=10,
        maximum_nonlinear_iterations=3,
        steady_initial=False,
    )
    (tmp_path / "tube.json").write_text(json.dumps(stiff))
    assert main(["solve", str(tmp_path / "tube.json"), str(tmp_path / "out.csv")]) == 1
    assert "did not converge at step" in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()
