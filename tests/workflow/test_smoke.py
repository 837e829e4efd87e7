"""The smallest campaign from end to end: every stage real, the report whole, the truth recovered within its error."""

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from coronaryuq.campaign import explain
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.records import read as read_records
from coronaryuq.core.units import MMHG
from coronaryuq.report.captions import CAPTIONS
from support import smoke

pytestmark = pytest.mark.workflow


def test_the_table_has_every_row_and_estimator(results):
    table = read_csv(results / "estimation" / "table.csv")
    kinds = list(dict.fromkeys(name.rpartition("_")[0] for name in table["row"]))
    averages = ["tawss_patch_flow", "low_shear_flow", "osi_patch_flow"]
    pressures = ["lowest_ffr", "pressure_drop"]
    extremes = ["osi_flow", "tawss_flow"]
    assert table["row"].nunique() == 27 and kinds == ["ffr_ffr", "ffr_flow", *pressures, *averages, *extremes]
    for row, lines in table.groupby("row"):
        networks = [] if row.rpartition("_")[0] in (*averages, *pressures) else ["MFMC-AE"]
        assert list(lines["estimator"]) == ["MC", "MFMC", *networks, "crossfit-GP"]
        assert lines["warnings"].str.startswith("extreme: ").all() == row.startswith(("osi_flow", "tawss_flow"))
    assert np.isfinite(table[["mean", "std"]]).all(axis=None)
    outputs = read_csv(results / "runs" / "outputs_3d.csv")
    same = table["column_3d"].map(outputs.nunique() == 1)
    assert ((table["std"] <= 1e-12 * table["mean"].abs()) == same).all()
    assert table["warnings"][same].str.contains("does not vary").all()


def test_the_lowest_ffr_lies_below_that_of_the_lesion_and_the_drop_below_what_it_lost(results):
    """And 0D, which reads at the same places, foretells both."""
    outputs, aorta = read_csv(results / "runs" / "outputs_3d.csv"), "aortic_pressure"
    for artery in ("lad", "lcx", "rca"):
        assert (outputs[f"lowest_ffr_{artery}"] <= outputs[f"ffr_{artery}"]).all()
        lost = (1 - outputs[f"ffr_{artery}"]) * outputs[aorta] / MMHG
        assert ((outputs[f"pressure_drop_{artery}"] > 0) & (outputs[f"pressure_drop_{artery}"] < lost)).all()
    table = read_csv(results / "estimation" / "table.csv")
    of_pressures = table[(table["estimator"] == "MFMC") & (table["column_3d"] == table["column_0d"])]
    assert len(of_pressures) == 9 and (of_pressures["rho_in_sample"] > 0.9).all()


def test_numbers_that_appear_twice_agree(results):
    table = read_csv(results / "estimation" / "table.csv").set_index(["row", "estimator"])
    for row, pairs in read_csv(results / "estimation" / "pairs.csv").dropna().groupby("row"):
        drawn = np.corrcoef(pairs["y"], pairs["q_resampled"])[0, 1]
        assert drawn == pytest.approx(table.loc[(row, "MFMC-AE"), "rho_held_out"], abs=1e-6)
    sources = [name for name in table if name.startswith("variance_")]
    assert np.allclose(table[sources].sum(axis=1), table["std"] ** 2)
    text = re.sub(r"<[^>]*>|,", "", (results / "report.html").read_text())
    total, *parts = re.search(
        r"0D runs: (\d+) \((\d+) at the inputs of 3D runs (\d+) for propagation (\d+)", text
    ).groups()
    assert int(total) == sum(map(int, parts)) and int(parts[-1]) == len(read_csv(results / "estimation/resampled.csv"))
    rows, of_folds, of_all = map(
        int, re.search(r"each of its (\d+) quantities (\d+) at .* and (\d+) of the fit", text).groups()
    )
    trained = table.xs("MFMC-AE", level="estimator")
    assert (trained["n_0d"] - trained["n_3d"] == of_folds).all()
    assert len(trained) == rows and rows * (of_folds + of_all) == int(parts[-1])


def test_flows_of_the_posterior_are_the_patients(results):
    truth = read_json(results / "patient" / "truth.json")["hyperaemia"]["flows"]
    predictive = read_json(results / "posterior" / "summary.json")["predictive"]
    targets = read_json(results / "perfusion" / "targets.json")
    flows = np.array([truth[bed] for bed in targets["bc"]])
    spread = np.sqrt(np.diag(np.array(targets["covariance"])))
    assert (np.abs(np.array(predictive["flow_mean"]) - flows) < 2 * spread).all()
    assert np.abs(np.array(predictive["flow_mean"]).sum() / flows.sum() - 1) < 0.1


def test_3d_and_0d_agree_on_what_both_know(results):
    records = [r for k in range(2) for r in read_records(results / "flow3d" / f"batch_{k}.jsonl")]
    assert len(records) == 16 and all(record.ok for record in records)
    for record in records:
        for branch in ("lad", "lcx", "rca"):
            assert 0.4 < record.outputs[f"ffr_{branch}"] < 1.0
            assert 0.0 <= record.outputs[f"osi_max_{branch}"] <= 0.5
            assert 0 < record.outputs[f"tawss_min_{branch}"] < record.outputs[f"tawss_patch_min_{branch}"]
            assert record.outputs[f"osi_patch_max_{branch}"] < record.outputs[f"osi_max_{branch}"]
    outputs_3d, outputs_0d = (read_csv(results / "runs" / f"outputs_{kind}.csv") for kind in ("3d", "0d"))
    for branch in ("lad", "lcx", "rca"):
        assert np.corrcoef(outputs_3d[f"ffr_{branch}"], outputs_0d[f"ffr_{branch}"])[0, 1] > 0.8


def test_the_report_contains_its_pictures_and_no_unfilled_fields(results):
    page = (results / "report.html").read_text()
    assert page.count('src="data:image/') == len(list((results / "figures").glob("*.png")))
    shown = re.sub(r"base64,[^\"]*|<(pre|script|style).*?</\1>", "", page, flags=re.S)  # without the configuration
    assert not re.search(r"\b(nan|None|undefined)\b", shown)
    assert "http://" not in shown and "https://" not in shown
    assert "The pressure drop is that from the start of the lesion to where its FFR is read." in shown


@pytest.mark.long
def test_snakemakes_own_report_holds_the_results(results, tmp_path):
    smoke.campaign(results.parents[1], "--report", str(tmp_path / "campaign.zip"))
    with zipfile.ZipFile(tmp_path / "campaign.zip") as archive:
        text = "".join(archive.read(name).decode() for name in archive.namelist() if name.endswith((".js", ".html")))
        held = {Path(name).name for name in archive.namelist()}
    assert {"report.html", "table.csv", "pressures.csv", "intervals_ffr.png"} <= held
    for words in (CAPTIONS["intervals_ffr"].title, CAPTIONS["flows"].title, "Fit to the data", "Posterior", "Summary"):
        assert words in text


def test_every_result_tells_where_it_comes_from(results):
    apart = ("logs", "provenance", "checkpoints", "chains")
    files = [path for path in results.rglob("*") if path.is_file() and not set(apart) & set(path.parts)]
    unknown = []
    for path in files:
        try:
            sound = path.name in explain.OF_THE_CAMPAIGN or explain.explain(path).unchanged
        except InputError as error:
            sound, path = False, error
        unknown += [] if sound else [str(path)]
    assert len(files) > 60 and not unknown


def spoil_every_kind(folder: Path) -> list[Path]:
    """Truncate, empty or alter one result of every kind, by folder and suffix, in turn; returns those spoiled."""
    told = {name for path in folder.glob("results/smoke/provenance/*.json") for name in read_json(path)["results"]}
    files = sorted(path for path in map(folder.joinpath, told) if path.is_file())
    kinds = {(path.parent.name, path.suffix): path for path in files}
    for number, path in enumerate(kinds.values()):
        whole = path.read_bytes()
        middle = len(whole) // 2
        path.write_bytes(
            (whole[:middle], b"", whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :])[number % 3]
        )
    return sorted(kinds.values())


def test_a_spoiled_file_of_any_kind_is_reported(results, tmp_path):
    copy = shutil.copytree(results, tmp_path / "results" / "smoke")
    assert explain.verify(copy).changed == []
    spoiled = spoil_every_kind(tmp_path)
    assert len(spoiled) >= 20 and explain.verify(copy).changed == spoiled


@pytest.mark.long
def test_spoiled_files_of_every_kind_are_made_again(results, tmp_path):
    again = shutil.copytree(results.parents[1], tmp_path / "again")
    spoil_every_kind(again)
    command = [sys.executable, "-m", "coronaryuq.cli.main", "verify", "--remove", "results/smoke"]
    assert subprocess.run(command, cwd=again).returncode == 0
    assert not smoke.differences(results, smoke.campaign(again))
    assert explain.verify(again / "results" / "smoke").changed == []


def test_figures_are_redrawn_to_the_same_bytes(results):
    every = sorted((results / "figures").iterdir())
    # A figure is one or more files of one name, in several formats.
    some = sorted({path.stem for path in every})[::5]
    figures = [path for path in every if path.stem in some]
    before = [path.read_bytes() for path in figures]
    for path in figures:
        path.unlink()
    smoke.campaign(results.parents[1], "--", "figures")
    assert [path.read_bytes() for path in figures] == before


@pytest.mark.long
def test_one_core_one_rank_and_other_portions_give_the_same_tables_and_figures(results, tmp_path):
    one_rank = ("--cores", "1", "--set-resources", "posterior_chains:tasks=1")
    assert not smoke.differences(results, smoke.campaign(tmp_path, *one_rank, more=(smoke.OTHER_PORTIONS,)))
