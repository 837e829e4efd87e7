"""Hidden cases as tables: what counts as right, which case counts where, and the page made of them."""

import pandas as pd

from coronaryuq.bench.discrepancy.tables import cells, chosen, measures, right, shares, tabulate
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.draw import draw
from coronaryuq.report.discrepancy_benchmark import write_page

LEAK = {"network": "open loop", "effect": "side_branch_leak", "strength": "medium", "noise": "nominal", "seed": 1}
LEAK |= {"first": "side_branch_leak", "named": True, "placed": False, "alarmed": True, "abstained": False}
LEAK |= {"covered": None, "worse": False, "before": 1.5, "after": 1.0, "oracle": 1.0, "cpu_s": 3.0}
NOTHING = LEAK | {"effect": "none", "strength": "none", "first": "none", "named": False, "alarmed": False}
SPASM = LEAK | {"effect": "outside:spasm", "first": "outside", "abstained": True}
SKIPPED = {name: LEAK[name] for name in ("network", "effect", "strength", "noise")} | {"seed": 9, "skipped": True}


def test_right_answers_have_the_right_name_and_place():
    assert not right(LEAK) and right(LEAK | {"placed": True})
    assert right(LEAK | {"effect": "side_branch_leak+pressure_offset"}), "of two effects, both names"
    assert right(NOTHING) and not right(NOTHING | {"alarmed": True})
    assert right(SPASM) and not right(SPASM | {"abstained": False})


def test_each_case_counts_in_its_measures():
    cases = [LEAK, LEAK | {"placed": True, "covered": True, "after": 1.4}, NOTHING | {"oracle": None}, SKIPPED]
    found = measures(chosen(cases, "open loop"))
    assert found["correct effect (or its class) first"] == (2, 2)
    assert found["correct location"] == (1, 2)
    assert found["coverage of the 90 % interval"] == (1, 1)
    assert found["false alarm, nothing hidden"] == (0, 1)
    assert found["≥ 90 % of the true effect's reduction of held-out misfit"] == (1, 2)
    assert found["named effects predict worse than recalibration"] == (0, 2), (
        "an answer without a name is recalibration"
    )
    assert not chosen(cases, "open loop", "weak") and not chosen(cases, "bundled patient")


def test_strong_cases_with_a_stenosis_are_those_of_a_closed_loop():
    case = LEAK | {"effect": "collateral", "strength": "strong", "noise": "half"}
    loop = case | {"network": "bundled patient"}
    assert chosen([loop, case], "bundled patient") == [loop]
    usual = loop | {"effect": "flow_gain"}
    assert chosen([usual], "bundled patient") == [] and chosen([usual], "bundled patient", "strong", "half") == [usual]
    assert chosen([loop, case], "open loop") == [] and chosen([loop, case], "open loop", "strong", "half") == [case]


def test_a_share_has_an_interval_and_a_cell_its_skipped_seeds():
    table = shares({"open loop": [LEAK, LEAK | {"placed": True}]}).set_index("tested")
    half = table.loc["correct location"]
    assert (half["held"], half["trials"], half["fraction"]) == (1, 2, 0.5)
    assert half["low"] < 0.1 and half["high"] > 0.9 and half["target_from"] == 0.9
    assert "“something else” outside the library" not in table.index, "no trial, no line"
    (cell,) = cells([LEAK, LEAK | {"seed": 2, "placed": True}, SKIPPED]).to_dict("records")
    assert (cell["right"], cell["cases"], cell["skipped"], cell["cpu_s"]) == (1, 2, 1, 3.0)


def test_runs_of_two_networks_become_tables_a_figure_and_a_page(tmp_path):
    other = [one | {"network": "loop"} for one in (LEAK, NOTHING, SPASM)]
    for name, cases in {"a": [LEAK, NOTHING, SKIPPED | {"effect": "collateral"}], "b": other}.items():
        write_json(tmp_path / f"{name}.json", {"cases": cases})
    tables = [tmp_path / f"{name}.csv" for name in ("shares", "cells", "answers")]
    tabulate([tmp_path / "a.json", tmp_path / "b.json"], *tables)
    named = read_csv(tables[2])
    assert named[named["network"] == "loop"]["named"].tolist() == ["side_branch_leak", "none", "outside"]
    assert pd.isna(read_csv(tables[1]).set_index("effect").loc["collateral", "cpu_s"])
    paths = dict(zip(("shares", "cells", "answers"), map(str, tables), strict=True))
    draw("hidden_effects", {name: paths[name] for name in ("shares", "answers")}, str(tmp_path / "figure.png"))
    write_page(**paths, figure=tmp_path / "figure.png", settings={"seeds": 1}, out=tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "<td>outside: spasm</td>" in page and "something else (1)" in page and "<td>nothing</td>" in page
    assert page.count("<td>0 of 1</td>") >= 2, "the leak's place in both networks"
    assert "0.000 to 0.793" in page and "≥ 0.95" in page
