"""Cases of the discrepancy benchmark and their tables in the documents are one."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
LEAK = {"effect": "side_branch_leak", "strength": "medium", "noise": "nominal", "seed": 1, "first": "side_branch_leak"}
LEAK |= {"named": True, "placed": False, "alarmed": True, "abstained": False, "covered": None, "worse": False}
LEAK |= {"before": 1.5, "after": 1.0, "oracle": 1.0, "cpu_s": 3.14159, "found": []}


@pytest.fixture(scope="module")
def script():
    found = importlib.util.spec_from_file_location("discrepancy_benchmark", DOCS / "discrepancy_benchmark.py")
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def test_the_pages_hold_the_tables_of_the_cases(script):
    for path, name, lines in script.tables(script.read(script.CASES)):
        page = path.read_text(encoding="utf-8")
        assert script.put(page, name, lines) == page, name


def test_a_case_that_ran_again_stands_once(script):
    one = script.kept(LEAK, "open loop")
    assert one["cpu_s"] == 3.14 and "covered" not in one and "found" not in one
    again = script.kept(LEAK | {"placed": True}, "open loop")
    assert script.merged([one], [again]) == [again]
    others = [script.kept(LEAK, "22 outlets"), script.kept(LEAK | {"seed": 2}, "open loop")]
    assert len(script.merged([one], others)) == 3


def test_what_counts_as_right(script):
    assert not script.right(LEAK) and script.right(LEAK | {"placed": True})
    assert script.right(LEAK | {"effect": "side_branch_leak+pressure_offset"}), "of two effects, both names"
    assert script.right(LEAK | {"effect": "none", "alarmed": False})
    assert script.right(LEAK | {"effect": "outside:spasm", "abstained": True})


def test_measures_count_each_case_where_it_belongs(script):
    cases = [LEAK, LEAK | {"placed": True, "covered": True, "after": 1.4}, LEAK | {"effect": "none", "oracle": None}]
    cases = [script.kept(case | {"seed": number}, "open loop") for number, case in enumerate(cases)]
    cases.append(script.kept(LEAK | {"skipped": True, "seed": 9}, "open loop"))
    found = script.measures(script.of(cases, "open loop"))
    assert found["right name (or its class) first"] == (2, 2)
    assert found["right place"] == (1, 2)
    assert found["90 % interval holds the size"] == (1, 1)
    assert found["false alarm, nothing hidden"] == (1, 1)
    assert found["≥ 90 % of the gap closed that the true effect closes"] == (1, 2)
    assert found["worse than recalibration"] == (0, 3)
    assert not script.of(cases, "open loop", "weak") and not script.of(cases, "bundled patient")


def test_strong_cases_beside_a_stenosis_are_those_of_a_closed_loop(script):
    case = LEAK | {"effect": "collateral", "strength": "strong", "noise": "half"}
    cases = [script.kept(case, "bundled patient"), script.kept(case, "open loop")]
    assert script.of(cases, "bundled patient") == cases[:1]
    assert script.of(cases, "open loop") == [] and script.of(cases, "open loop", "strong", "half") == cases[1:]
