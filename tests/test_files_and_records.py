"""Files are whole or absent; records come back as they went, and broken ones are named."""

import math

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.cli import main
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io import files

floats = st.floats(allow_nan=False, allow_infinity=False)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "table.json"
    files.write_json(target, {"a": 1})
    with pytest.raises(RuntimeError), files.replacing(target) as beside:
        beside.write_text("half")
        raise RuntimeError
    assert files.read_json(target) == {"a": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["table.json"]


@pytest.mark.parametrize("text", ["", "{", '{"a": 1', "\x00\xff"])
def test_broken_json_is_named_on_one_line(tmp_path, text):
    path = tmp_path / "case.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError) as caught:
        files.read_json(path)
    assert "case.json" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "raw",
    [
        b"name,value\nvan Gogh,1.5\nb,-2\n",
        b"\xef\xbb\xbfname,value\r\nvan Gogh,1.5\r\nb,-2\r\n",
        b"# by hand\nname,value\nvan Gogh,1.5\n# and more\nb,-2\n",
        b"name;value\nvan Gogh;1,5\nb;-2\n",
        b"name;value\nvan Gogh;1.5\nb;-2\n",
        b"name\tvalue\nvan Gogh\t1.5\nb\t-2\n",
        b"name;value\r\nvan Gogh;1.5\r\n;\r\nb;-2\r\n ; \r\n;\r\n",
        "name,value\nvan Gogh,1.5\nb,-2\n".encode("utf-16"),
        b"sep=;\r\nname;value\r\nvan Gogh;1,5\r\nb;-2\r\n",
    ],
)
def test_a_table_reads_the_same_however_a_spreadsheet_wrote_it(tmp_path, raw):
    (tmp_path / "t.csv").write_bytes(raw)
    frame = files.read_csv(tmp_path / "t.csv", ("name", "value"))
    assert frame["name"].tolist() == ["van Gogh", "b"] and frame["value"].tolist() == [1.5, -2.0]


def test_a_table_in_windows_western_code_page(tmp_path):
    (tmp_path / "t.csv").write_bytes("name,note\na,3 µm\n".encode("cp1252"))
    assert files.read_csv(tmp_path / "t.csv")["note"].tolist() == ["3 µm"]


def test_a_result_that_cannot_be_written_is_one_line(tmp_path, capsys):
    network = {
        "simulation_parameters": {"number_of_cardiac_cycles": 1, "number_of_time_pts_per_cardiac_cycle": 3},
        "boundary_conditions": [
            {"bc_name": "IN", "bc_type": "FLOW", "bc_values": {"t": [0, 1], "Q": [1, 1]}},
            {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": 1.0, "Pd": 0.0}},
        ],
        "junctions": [],
        "vessels": [
            {
                "vessel_id": 0,
                "vessel_name": "v",
                "boundary_conditions": {"inlet": "IN", "outlet": "OUT"},
                "zero_d_element_type": "BloodVessel",
                "zero_d_element_values": {"R_poiseuille": 1.0},
            }
        ],
    }
    files.write_json(tmp_path / "n.json", network)
    table = tmp_path / ("x" * 300)
    assert main.main(["solve", str(tmp_path / "n.json"), str(table)]) == 2
    assert capsys.readouterr().err == f"error: {table}: File name too long\n"


@pytest.mark.parametrize("command", ["tune", "fit", "discrepancy"])
def test_a_folder_for_results_that_is_a_file_is_told_before_the_work(tmp_path, capsys, command):
    (tmp_path / "file").write_text("")
    words = {"tune": ["n.json", "t.csv"], "fit": ["n.json", "t.csv"], "discrepancy": ["--pairs", "s.csv", "m.csv"]}
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert main.main([command, *words[command], "--out", str(out)]) == 2
        said = f"error: {out}: wanted a folder for results, and {tmp_path / 'file'} is a file\n"
        assert capsys.readouterr().err == said


def test_missing_column_is_named_with_those_present(tmp_path):
    (tmp_path / "t.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="t.csv: c: column missing; the file has a, b"):
        files.read_csv(tmp_path / "t.csv", columns=("c",))


@given(value=floats, text=st.text(max_size=20))
def test_records_survive_the_round_trip_to_the_bit(tmp_path_factory, value, text):
    path = tmp_path_factory.mktemp("records") / "batch.jsonl"
    written = [
        records.Record("sample_0000", {"BC_lca1": value}, {"ffr_lad": value}, diagnostics={"note": text}),
        records.Record.failed("sample_0001", {"BC_lca1": value}, "blew up\nat step 3"),
    ]
    records.write(path, written)
    back = records.read(path)
    assert back == written
    assert back[0].ok and not back[1].ok and back[1].reason == "blew up at step 3"
    assert math.copysign(1, back[0].outputs["ffr_lad"]) == math.copysign(1, value)


@pytest.mark.parametrize(
    "text", ["", '{"sample": "a"', '{"sample": "a"}\n', '{"sample": "a", "inputs": {}, "x": 1}\n', "[1]\n"]
)
def test_broken_records_are_named(tmp_path, text):
    path = tmp_path / "batch_3.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match="batch_3.jsonl"):
        records.read(path)


@given(st.lists(floats, min_size=1, max_size=20))
def test_csv_floats_survive_the_round_trip_to_the_bit(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("table") / "t.csv"
    files.write_csv(path, pd.DataFrame({"a": values}))
    assert files.read_csv(path)["a"].tolist() == values


@pytest.mark.parametrize("row", ["1,2,3\n", "1,2,\n", "1,2,3,4\n"])
def test_rows_longer_than_the_heading_are_not_shifted(tmp_path, row):
    (tmp_path / "table.csv").write_text("a,b\n" + row)
    with pytest.raises(InputError, match="heading: rows have more cells than it has columns"):
        files.read_csv(tmp_path / "table.csv")
