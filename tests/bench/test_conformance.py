"""Benchmark of the agreement with svZeroDSolver: its keys, its measure of difference, and the table in the docs."""

import json

import pytest

from coronaryuq.bench import conformance
from coronaryuq.cli.main import main
from coronaryuq.zerod.svzerodsolver import program, tables
from support.benchmark_scripts import benchmark_script
from support.zerod_networks import bifurcation, built_heart


@pytest.fixture
def folder(tmp_path):
    if program.installed() is None:
        pytest.skip("needs svZeroDSolver: pip install svzerod")
    wrong = bifurcation()
    wrong["simulation_parameters"]["cardiac_period"] = 1.2
    long = bifurcation()
    long["simulation_parameters"]["number_of_cardiac_cycles"] = 200
    contents = {"tree": bifurcation(), "heart": built_heart(), "wrong": wrong, "long": long}
    for name, content in contents.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "result_tree.json").write_text("[]")
    return tmp_path


def test_the_command_prints_one_json_object(folder, capfd):
    assert main(["bench", "conformance", "--cases", str(folder), "--quick", "--json"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert [case["case"] for case in result["cases"]] == ["heart.json", "tree.json", "wrong.json"]
    assert (result["compared"], result["agree"], result["refused_by_both"], result["disagree"]) == (3, 2, 1, [])
    tree = result["cases"][1]
    assert tree["difference"] < 1e-9 and tree["rows"] == 3 * 101 and tree["own_change"] is None


def test_a_difference_is_measured_against_the_largest_value_of_its_unknown():
    table = tables.simulate(bifurcation())
    moved = table.copy()
    left = moved["name"] == "left"
    largest = table.loc[left, "flow_out"].abs().max()
    moved.loc[moved.index[left][7], "flow_out"] += 1e-3 * largest
    found, where = conformance.difference(moved, table)
    assert found == pytest.approx(1e-3) and where == "left flow_out"
    assert conformance.difference(table.drop(columns="flow_in"), table)[0] == float("inf")


def test_a_case_that_only_one_of_both_solves_disagrees(folder, monkeypatch):
    monkeypatch.setattr(conformance.tables, "simulate", lambda *given: (_ for _ in ()).throw(RuntimeError("no")))
    result = conformance.run(quick=True, cases=str(folder))
    assert result["disagree"] == ["heart.json", "tree.json"] and result["agree"] == 0


def test_the_page_holds_the_table_of_the_recorded_run():
    script = benchmark_script("zerod_conformance")
    page = script.PAGE.read_text(encoding="utf-8")
    assert script.put(page, json.loads(script.RUN.read_text(encoding="utf-8"))) == page
