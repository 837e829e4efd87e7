"""The table of estimates: warnings by their kind, names that a reader knows."""

from coronaryuq.report.table import Notes, table_lines
from support.estimates import estimator, row


def test_warnings_of_one_kind_share_a_number_and_name_their_lines():
    notes = Notes({"BC_lca10": "OM2"})
    assert notes.numbers(["long tail: of MC", "few runs: 16"], "FFR LAD") == [1, 2]
    assert notes.numbers(["long tail: of MFMC, most in BC_lca10"], "FFR RCA") == [1]
    first = notes.groups[0]
    assert (first["kind"], first["count"]) == ("Long tail", 2)
    assert first["texts"] == [
        {"text": "of MC", "lines": "FFR LAD"},
        {"text": "of MFMC, most in OM2", "lines": "FFR RCA"},
    ]


def test_every_number_of_a_line_has_the_tables_own_value():
    one = row(estimators={"MC": estimator(mean=0.84567, std=0.0123)})
    (line,) = table_lines(one, [one], "", Notes({}))
    cells = {cell["key"]: cell for cell in line["cells"]}
    assert cells["mean"] == {"key": "mean", "text": "0.846", "raw": 0.84567}
    assert cells["std"]["text"] == "0.0123" and cells["rho_held_out"]["text"] == "–"
    assert line["recommended"] and line["name"] == "MC"


def test_the_figure_marks_the_lines_that_carry_a_number_of_a_warning():
    both = {"MC": estimator(), "MFMC": estimator(warnings=["no gain: of MFMC"])}
    one = row(estimators=both, recommended="MFMC", warnings=["one run dominates: pilot_1"])
    lines = {line["name"]: line for line in table_lines(one, [one], "", Notes({}))}
    assert lines["MC"]["notes"] == [] and one.warnings_of("MC") == []
    assert lines["MFMC"]["notes"] == [1, 2] and len(one.warnings_of("MFMC")) == 2
