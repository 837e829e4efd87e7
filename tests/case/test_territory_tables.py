"""Territories as a table: every form that users have gives the same flows, and a wrong one is one line."""

import json

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from support.case_files import check_case, write_case

FLOW = np.array([2.0, 1.2, 0.8])
"""mL/s, of lca1, lca2, rca1."""
VOLUME = np.array([50.0, 30.0, 40.0])
"""cm3."""


def table(*names, **columns):
    header = ",".join(["name", *columns])
    rows = zip(names or ("lca1", "lca2", "rca1"), *columns.values(), strict=True)
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


def case_of(folder, tree, text, how):
    path = write_case(folder, tree, perfusion=None, territory_flows=f"{{file: flows.csv, {how}}}")
    (folder / "flows.csv").write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "how", "flow", "volume"),
    [
        (table(flow=FLOW), "unit: mL/s", FLOW, None),
        (table(flow=FLOW * 60, volume=VOLUME), "unit: mL/min", FLOW, VOLUME),
        (table(flow=FLOW / 4, volume=VOLUME), "unit: fraction, total: 4", FLOW, VOLUME),
        (table(flow=FLOW / 4), "unit: fraction, total: 240, total_unit: mL/min", FLOW, None),
        (table(volume=VOLUME), "unit: volume, total: 6", VOLUME / 20, VOLUME),
        (table(mbf=FLOW / VOLUME / 1.05 * 60, volume=VOLUME), "unit: mL/min/g", FLOW, VOLUME),
        (table(mbf=FLOW / VOLUME * 6000, volume=VOLUME), "unit: mL/min/100mL", FLOW, VOLUME),
        (table("BC_rca1", "BC_lca1", "lca2", flow=FLOW[[2, 0, 1]]), "unit: mL/s", FLOW, None),
    ],
)
def test_every_form_of_the_table_gives_its_flows(small_tree, tmp_path, text, how, flow, volume):
    prepare_case(case_of(tmp_path, small_tree, text, how), Settings(), tmp_path / "case")
    density = json.loads((tmp_path / "case/case.json").read_text())["tissue_density"]
    wall = pv.read(tmp_path / "case/lv.vtu")
    assert wall.cell_data["MBF"] * wall.cell_data["Volume"] * density == pytest.approx(flow, rel=1e-12)
    if volume is not None:
        assert wall.cell_data["Volume"] == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "how", "expected"),
    [
        (table(flow=FLOW), "unit: mL/min", "territory_flows.unit = 'mL/min': gives an LV flow of 0.0667 mL/s"),
        (table(flow=FLOW * 60), "unit: mL/s", "territory_flows.unit = 'mL/s': gives an LV flow of 240 mL/s"),
        (table(flow=FLOW / 4), "unit: fraction, total: 240", "territory_flows.total = '240 mL/s': gives an LV flow of"),
        (table(flow=FLOW), "unit: fraction, total: 4", "flow = 4.0: fractions must add up to 1"),
        (table(flow=FLOW / 4), "unit: fraction", "give total with unit fraction or volume, and only then"),
        (table(flow=FLOW), "unit: mL/s, total: 4", "give total with unit fraction or volume, and only then"),
        (table(volume=VOLUME), "unit: mL/s", "flow: column missing; the file has name, volume"),
        (table(flow=FLOW), "unit: volume, total: 4", "volume: column missing; the file has name, flow"),
        (table(volume=VOLUME * 1000), "unit: volume, total: 4", "= '1.2e+05 cm3': implausible wall volume"),
        (table(volume=VOLUME), "unit: volume, total: 0.15", "gives a mean flow of 0.0714 mL/min/g, outside 0.1 to 10"),
        (
            table(mbf=FLOW * 60, volume=VOLUME),
            "unit: mL/min/g",
            "= 'mL/min/g': gives an LV flow of 176 mL/s; check the",
        ),
        (table(flow=[2, -1, 1]), "unit: mL/s", "flow of lca2 = -1.0: must be positive"),
        (table(flow=[2, "nan", 1]), "unit: mL/s", "flow: not given for lca2; measure it (unit mL/s)"),
        (table(flow=FLOW, volume=[50, 0, 40]), "unit: mL/s", "volume of lca2 = 0.0: must be positive"),
        (table("lca1", "lca2", "lca1", flow=FLOW), "unit: mL/s", "name = 'lca1': duplicate"),
        (table("lca1", "lca2", "BC_lca1", flow=FLOW), "unit: mL/s", "name = 'BC_lca1': duplicate"),
        (table("lca1", "lca2", "x", flow=FLOW), "unit: mL/s", "name = 'x': not an outlet that perfuses the LV"),
        ("name,flow\nlca1,2\nlca2,1\n", "unit: mL/s", "name = 'rca1': missing; every outlet that perfuses the LV"),
        (
            "name,flow\nlca1,2\nlca2,1\nrca1,1\nx,1\ny,1\n",
            "unit: mL/s",
            "name = 'x, y': not outlets that perfuse the LV by the outlets table; delete their rows",
        ),
        ("name,flow\nlca1,2\nlcx,1\nrca1,1\n", "unit: mL/s", "or correct the name; without a row: lca2"),
        ("name,flow\nlca1,2\n", "unit: mL/s", "name = 'lca2, rca1': missing; every outlet that perfuses the LV"),
        (table(flow=FLOW), "unit: litre", "territory_flows.unit = 'litre': input should be"),
    ],
)
def test_a_wrong_table_is_one_line(small_tree, tmp_path, text, how, expected):
    findings, _ = check_case(case_of(tmp_path, small_tree, text, how))
    assert len(findings) == 1 and "\n" not in findings[0]
    assert expected in findings[0]
