"""The index of a results folder: what a file is, its columns, their units."""

import json

import pytest

from coronaryuq.campaign.files import KINDS, kind_of, units
from coronaryuq.campaign.index import describe_results, write_index
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.discrepancy.result.pullback_table import KEPT
from coronaryuq.discrepancy.result.source_table import COLUMNS as SOURCE
from coronaryuq.discrepancy.result.write import DETECTABLE, WRITTEN


@pytest.fixture
def home(tmp_path):
    """A results folder with two tables, one of them remade by a later job, and files that the index leaves apart."""
    home = tmp_path / "results" / "mine"
    write_text(home / "campaign.yaml", "name: mine\ncase: my/case.yaml\nseed: 5\n")
    write_text(home / "posterior" / "draws.csv", "chain,generation,BC_a,log_density\n0,1,1.0,2.0\n")
    write_text(home / "runs" / "outputs_3d.csv", "sample,ffr_lad,tawss_min_lad\np,0.8,10\n")
    write_text(home / "logs" / "case.log", "done\n")
    write_text(home / "notes.txt", "mine\n")
    for job, made in (("posterior", "2026-01-01"), ("posterior again", "2026-01-02")):
        note = {"job": job, "made": made, "results": {"results/mine/posterior/draws.csv": "0" * 64}}
        write_json(home / "provenance" / f"{job}.json".replace(" ", "-"), note)
    return home


def test_files_columns_and_units_are_listed(home):
    write_index(home)
    index = json.loads((home / "index.json").read_text())
    files = {entry["file"]: entry for entry in index["files"]}
    assert set(files) == {"campaign.yaml", "notes.txt", "posterior/draws.csv", "runs/outputs_3d.csv"}
    assert files["posterior/draws.csv"]["made_by"] == "posterior again"
    assert files["notes.txt"]["what"] is None, "no job writes it"
    columns = {column["name"]: column for column in index["columns"]["runs/outputs_3d.csv"]}
    assert columns["tawss_min_lad"]["unit"] == "dyn/cm2" and columns["ffr_lad"]["unit"] == "1"
    readme = (home / "README.md").read_text()
    assert "the case `my/case.yaml`, seed 5" in readme and "| `logs/` | output of every job | – |" in readme


def test_an_unknown_column_has_no_unit():
    assert units("runs/outputs_3d.csv", ["sample", "ffr_rca", "surprise"]) == {"sample": "text", "ffr_rca": "1"}
    assert kind_of("posterior/surprise.csv") is None and units("posterior/surprise.csv", ["x"]) == {}


@pytest.mark.parametrize("name", WRITTEN)
def test_every_file_that_a_search_may_write_is_described(name):
    case = "pairs" if name in ("pairs.csv", "laws.csv", "predicted.csv") else "case"
    assert kind_of(f"discrepancy/{case}/found/{name}") is not None


def test_every_column_of_a_search_s_tables_has_a_unit():
    pullback = (*KEPT, "vessel", "acting", "named")
    for name, columns in (("source.csv", SOURCE), ("pullback.csv", pullback), ("detectable.csv", DETECTABLE)):
        assert set(units(f"discrepancy/case/found/{name}", list(columns))) == set(columns)


def test_every_meaning_and_unit_is_written_out():
    for kind in KINDS:
        assert kind.what
        assert all(expression and what and unit for expression, what, unit in kind.columns)


def test_a_folder_that_cannot_be_described_is_a_note_and_a_missing_one_stays_missing(home, tmp_path, capsys):
    table = home / "zerod" / "pilot_0.parquet"
    write_text(table, "not a table")
    describe_results(home)
    assert "note: no index of" in capsys.readouterr().err
    table.unlink()
    write_text(home / "provenance" / "broken.json", "{")
    describe_results(home)
    assert "note: no index of" in capsys.readouterr().err and not (home / "index.json").exists()
    describe_results(tmp_path / "results" / "other")
    assert not (tmp_path / "results" / "other").exists()
