"""Lowest FFR and pressure drops on the page: which is the lowest, where, and in which units."""

import pandas as pd
import pytest

from coronaryuq.core.io.tables import write_csv
from coronaryuq.report import predicted
from coronaryuq.report.tree import READINGS, Readings
from coronaryuq.zerod.predicted import COLUMNS
from support.case_files import small_tree

NAMES = {"aorta": "aorta", "aorta_outlet": "aorta", "branch1": "LM", "lca1": "LAD", "lca2": "LCx", "rca1": "PDA"}
ROWS = [
    ("lowest FFR", "LM", "LM", "branch1", 3.2, "1", 0.97, 0.98, 0.99),
    ("lowest FFR", "LAD", "LAD", "lca1", 4.0, "1", 0.65, 0.7, 0.75),
    ("lowest FFR", "RCA", "RCA", "rca1", 3.1, "1", 0.85, 0.9, 0.95),
    ("pressure drop", "LAD2", "LAD", "lca1", 2.0, "mmHg", 10.04, 12.06, 15.0),
]


@pytest.fixture
def table(tmp_path):
    write_csv(tmp_path / "predicted.csv", pd.DataFrame(ROWS, columns=COLUMNS))
    return predicted.read_predicted(tmp_path / "predicted.csv")


@pytest.fixture
def readings():
    return Readings(small_tree(), NAMES, pd.DataFrame(columns=["vessel", "position", *READINGS]))


def test_the_lowest_ffr_of_the_tree_is_told_with_its_place(table, readings):
    found = predicted.lowest(table, readings)
    assert (found["ffr"], found["ffr_low"], found["ffr_high"], found["below"]) == ("0.70", "0.65", "0.75", True)
    assert found["where"] == "at the end of the LAD (diameter there 2.4 mm)"
    assert predicted.lowest(table[table["quantity"] == "pressure drop"], readings) == {}


def test_each_row_has_its_place_and_unit(table, readings):
    main, lad, right, drop = predicted.lines(table, readings)
    assert main["where"].startswith("in the LM") and not main["below"] and lad["below"]
    assert right["where"] == "in the PDA (diameter there 3.0 mm)"
    assert (drop["name"], drop["what"], drop["median"]) == ("LAD2 stenosis", "Pressure drop (mmHg)", "12.1")
    assert drop["range"] == "10.0 to 15.0" and not drop["below"]
