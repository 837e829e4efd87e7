"""Lowest FFR and pressure drops on the page: which is the lowest, where, and in which units."""

import pandas as pd
import pytest

from coronaryuq.core.io.tables import write_csv
from coronaryuq.report import predicted
from coronaryuq.report.discrepancy import environment
from coronaryuq.report.tree import READINGS, Readings
from coronaryuq.zerod.predicted import COLUMNS
from support.case_files import small_tree

NAMES = {"aorta": "aorta", "aorta_outlet": "aorta", "branch1": "LM", "lca1": "LAD", "lca2": "LCx", "rca1": "PDA"}
ROWS = [
    ("lowest FFR", "LM", "LM", "branch1", 3.2, "1", 0.97, 0.98, 0.99),
    ("lowest FFR", "LAD", "LAD", "lca1", 4.0, "1", 0.65, 0.7, 0.75),
    ("lowest FFR", "RCA", "RCA", "rca1", 3.1, "1", 0.85, 0.9, 0.95),
    ("pressure drop", "LAD2", "LAD", "lca1", 2.0, "mmHg", 10.04, 12.06, 15.0),
    ("FFR at a place", "distal", "LAD", "lca1", 1.5, "1", 0.7, 0.75, 0.8, 0.84, 0.02, -0.09, 0.69, 0.81, "no"),
    ("FFR at a place", "exact", "LAD", "lca1", 1.5, "1", 0.7, 0.75, 0.8, 0.748, None, 0.002, 0.7, 0.8, "yes"),
    ("FFR at a place", "LCx 1.0 cm", "LCx", "lca2", 1.0, "1", 0.9, 0.95, 0.99),
]


@pytest.fixture
def table(tmp_path):
    write_csv(
        tmp_path / "predicted.csv",
        pd.DataFrame([row + (None,) * (len(COLUMNS) - len(row)) for row in ROWS], columns=COLUMNS),
    )
    return predicted.read_predicted(tmp_path / "predicted.csv")


@pytest.fixture
def readings():
    return Readings(small_tree(), NAMES, pd.DataFrame(columns=["vessel", "position", *READINGS]))


def test_the_lowest_ffr_of_the_tree_is_told_with_its_place(table, readings):
    found = predicted.lowest(table, readings)
    assert (found["ffr"], found["ffr_low"], found["ffr_high"], found["below"]) == ("0.70", "0.65", "0.75", True)
    assert found["where"] == "at the end of the LAD (diameter there 2.4 mm)" and found["in_artery"]
    assert not predicted.lowest(table.assign(artery="RCA"), readings)["in_artery"]
    assert predicted.lowest(table[table["quantity"] == "pressure drop"], readings) == {}


def test_each_row_has_its_place_and_unit(table, readings):
    main, lad, right, drop = predicted.lines(table, readings)[:4]
    assert main["where"].startswith("in the LM") and not main["below"] and lad["below"]
    assert right["where"] == "in the PDA (diameter there 3.0 mm)"
    assert (drop["name"], drop["what"], drop["median"]) == ("LAD2 stenosis", "Pressure drop (mmHg)", "12.1")
    assert drop["range"] == "10.0 to 15.0" and not drop["below"]


def test_a_place_of_a_wire_has_its_measured_value_and_how_the_prediction_compares(table, readings):
    distal, exact, unmeasured = predicted.lines(table, readings)[4:]
    assert distal["where"] == "3.5 cm from the ostium, in the LAD (diameter there 2.9 mm)" and distal["below"]
    assert (distal["measured"], distal["with_sd"], distal["apart"]) == ("0.84 ± 0.02", True, True)
    assert distal["comparison"] == "predicted 0.09 lower; outside 0.69 to 0.81"
    assert (exact["measured"], exact["with_sd"], exact["apart"]) == ("0.75", False, False)
    assert exact["comparison"] == "predicted alike; within 0.70 to 0.80"
    assert (unmeasured["measured"], unmeasured["comparison"]) == ("", "") and unmeasured["name"] == "LCx 1.0 cm"


@pytest.mark.parametrize(
    ("kept", "told", "untold"),
    [
        (["distal"], ["holds it and the range of states together"], ["does not hold the wire's own error"]),
        (["LAD", "distal", "exact"], ["holds it and the range of states", "does not hold the wire's own error"], []),
        (["exact"], ["does not hold the wire's own error"], ["holds it and the range"]),
        (["LCx 1.0 cm"], [], ["Comparison", "A measured FFR is compared"]),
    ],
)
def test_the_page_says_what_the_range_holds(table, readings, kept, told, untold):
    lines = predicted.lines(table[table["name"].isin(kept)], readings)
    page = environment().get_template("along_arteries.html").render(predicted=lines)
    text = " ".join(page.split())
    assert all(words in text for words in told) and not any(words in text for words in untold)
    assert ("0.84 ± 0.02" in text) == ("distal" in kept)
