"""`coronaryuq fit`: a network and a table in, the table's fractions out of the network that it writes."""

import json

import numpy as np
import pytest

from coronaryuq.case.case_json import read_case
from coronaryuq.cli.main import main
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.zerod.network.beds import distal_resistances
from coronaryuq.zerod.network.read import read_network

SHARES = np.array([0.40, 0.03, 0.25, 0.12, 0.20])


def table(path, columns, names=range(5)):
    rows = zip(names, *columns.values(), strict=True)
    path.write_text(f"name,{','.join(columns)}\n" + "".join(f"{','.join(map(str, row))}\n" for row in rows))
    return str(path)


@pytest.mark.parametrize(
    "columns",
    [
        {"flow": 250 * SHARES},
        {"volume": 110 * SHARES},
        {"volume": 10 * np.ones(5), "mbf": SHARES},
        {"flow": SHARES, "volume": np.arange(1.0, 6)},
        {"flow": [0.996, 0.001, 0.001, 0.001, 0.001]},
    ],
)
def test_the_network_that_it_writes_meets_the_fractions(campaign, tmp_path, capsys, columns):
    """Shares far from the network's own, of five beds out of six; the sixth keeps its resistance."""
    wanted = np.prod([columns[c] for c in (("flow",) if "flow" in columns else columns)], axis=0)
    wanted = wanted / wanted.sum()
    flows = table(tmp_path / "flows.csv", columns)
    assert main(["fit", str(campaign[1]), flows, "--out", str(tmp_path / "out"), "--json"]) == 0
    said, found = json.loads(capsys.readouterr().out), read_csv(tmp_path / "out" / "fractions.csv")
    vessels = {outlet.bc: outlet.vessel for outlet in read_case(campaign[0]).outlets[:5]}
    fitted = BedFlows(tmp_path / "out" / "fitted.json", vessels, tolerance=1e-6, steps_per_cycle=None)
    anew = fitted.flows(np.ones((1, 5)))[0]
    assert np.allclose(anew / anew.sum(), wanted, rtol=1e-4)
    assert list(found["bc"]) == [f"BC_{i}" for i in range(5)]
    assert np.allclose(found["target_fraction"], wanted)
    assert said["largest_fraction_error"] < 1e-4
    assert said["largest_fraction_error"] == pytest.approx(np.abs(found["fitted_error"]).max())
    before, after = distal_resistances(read_network(campaign[1])), distal_resistances(fitted.network)
    assert after["BC_5"] == before["BC_5"]
    assert np.isclose(*(sum(1 / r[f"BC_{i}"] for i in range(5)) for r in (before, after)))


def test_hyperaemia_comes_first(campaign, tmp_path, capsys):
    flows = table(tmp_path / "flows.csv", {"flow": SHARES})
    main(["fit", str(campaign[1]), flows, "--hyperaemia", "0.24", "--json"])
    rows = json.loads(capsys.readouterr().out)["beds"]
    rest = distal_resistances(read_network(campaign[1]))
    assert all(np.isclose(row["first_resistance"], (0.8 * 0.24 + 0.2) * rest[row["bc"]]) for row in rows)


def test_a_negative_resistance_is_taken_with_a_note(campaign, tmp_path, capsys):
    network = read_network(campaign[1])
    bed = next(block for block in network["boundary_conditions"] if block["bc_name"] == "BC_1")
    bed["bc_values"]["Ra1"] = -5.0
    write_json(tmp_path / "loop.json", network)
    assert main(["fit", str(tmp_path / "loop.json"), table(tmp_path / "flows.csv", {"flow": SHARES})]) == 0
    assert capsys.readouterr().err == f"note: {tmp_path}/loop.json: BC_1.Ra1 = -5: negative resistance\n"


@pytest.mark.parametrize(
    ("columns", "names", "expected"),
    [
        ({"flow": SHARES}, ["0", "1", "2", "3", "x"], "name = 'x': not a coronary bed; there are BC_0"),
        ({"flow": SHARES}, ["0", "1", "2", "3", "BC_0"], "name = 'BC_0': duplicate"),
        ({"flow": [1, 2, -3, 4, 5]}, range(5), "flow of BC_2 = -3.0: must be a positive number"),
        ({"volume": [1, 2, "", 4, 5]}, range(5), "volume of BC_2 = nan: must be a positive number"),
        ({"mbf": SHARES}, range(5), "flow: column missing; expected flow, or mbf and volume, or volume"),
        ({"flow": [1]}, ["0"], "rows = 1: at least two beds are required"),
    ],
)
def test_a_wrong_table_is_one_line(campaign, tmp_path, capsys, columns, names, expected):
    assert main(["fit", str(campaign[1]), table(tmp_path / "flows.csv", columns, names)]) == 2
    error = capsys.readouterr().err
    assert expected in error and error.count("\n") == 1
