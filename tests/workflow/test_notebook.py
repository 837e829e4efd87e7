"""What a finished campaign offers: tables in a notebook, an index of every file, the examples of the documentation."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import coronaryuq
from coronaryuq.campaign.index import INDEX, README, write_index
from coronaryuq.cli.examples import EXAMPLES
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from support.served import served
from support.tutorials import follow

pytestmark = [pytest.mark.workflow, pytest.mark.long]

ROOT = Path(__file__).parents[2]
NOT_RUN = {"run", "demo", "completion", "doctor", "bench", "tune", "serve", "discrepancy", "--remove", "--help"}
"""Examples that take minutes, do not end, need another target, delete results, or are tested elsewhere."""


@pytest.fixture
def opened(results):
    return coronaryuq.open(results)


def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.DOTALL)


def table_columns(path: Path) -> list[str]:
    frame = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    return [str(name) for name in frame.columns]


def test_every_file_is_described_and_every_column_has_a_meaning_and_a_unit(results):
    index = json.loads((results / INDEX).read_text())
    described = {entry["file"]: entry for entry in index["files"]}
    apart = {"logs", "provenance", "costs", "checkpoints", "chains", "mesh-complete"}
    files = [p for p in results.rglob("*") if p.is_file() and not apart & set(p.relative_to(results).parts[:-1])]
    names = {p.relative_to(results).as_posix() for p in files} - {".lock", INDEX, README}
    assert names == set(described)
    assert not [name for name, entry in described.items() if not entry["what"]]
    assert [name for name, entry in described.items() if not entry["made_by"]] == ["campaign.yaml"]
    tables = [name for name in names if name.endswith((".csv", ".parquet"))]
    assert len(tables) > 20
    for name in tables:
        wanted = ["name", "description", "value"] if name == "patient/targets.csv" else table_columns(results / name)
        columns = index["columns"][name]
        assert [column["name"] for column in columns] == wanted, name
        assert all(column["what"] and column["unit"] for column in columns), name


def test_the_index_is_the_same_bytes_again_and_the_readme_names_the_folders(results):
    before = (results / INDEX).read_bytes(), (results / README).read_bytes()
    write_index(results)
    assert ((results / INDEX).read_bytes(), (results / README).read_bytes()) == before
    assert "| `estimation/` | estimates with their intervals |" in before[1].decode()


def test_tables_are_those_of_the_files_with_units(opened, results):
    assert list(opened.ffr.index) == ["LAD", "LCx", "RCA"]
    assert ((opened.ffr["low"] < opened.ffr["mean"]) & (opened.ffr["mean"] < opened.ffr["high"])).all()
    assert ((opened.ffr["q05"] < opened.ffr["median"]) & (opened.ffr["median"] < opened.ffr["q95"])).all()
    estimates, table = opened.estimates, read_csv(results / "estimation" / "table.csv")
    pd.testing.assert_frame_equal(estimates[table.columns], table, check_exact=True)
    assert estimates.groupby("row")["recommended"].sum().eq(1).all()
    assert set(estimates.loc[estimates["column_3d"] == "tawss_min_lad", "unit"]) == {"dyn/cm2"}
    for frame in (opened.ffr, estimates, opened.draws, *(run.reset_index() for run in opened.runs.values())):
        assert set(frame.attrs["units"]) == set(map(str, frame.columns))
    assert opened.runs["params"].index.equals(opened.runs["outputs_3d"].index)


def test_objects_are_those_of_the_usual_libraries(opened):
    r = opened.posterior["posterior"]["r"]
    assert r.shape[0] == 12 and [f"BC_{name}" for name in ("lca1",)] == list(r["bed"].values[:1])
    assert opened.network["closed_loop_blocks"] and opened.report.is_file()
    assert opened.figures["marginals"]._repr_png_().startswith(b"\x89PNG")
    assert "made by     estimation" in repr(opened.explain("estimation/table.csv"))
    assert "<table" in opened._repr_html_() and "Campaign smoke" in opened._repr_html_()


def test_what_is_not_computed_yet_names_its_target_in_one_line(results, tmp_path):
    home = tmp_path / "results" / "smoke"
    home.mkdir(parents=True)
    (home / "campaign.yaml").write_bytes((results / "campaign.yaml").read_bytes())
    started = coronaryuq.open(home)
    for ask, target in {
        "ffr": "estimation/estimates.json", "estimates": "estimation/table.csv", "runs": "runs/rows.csv",
        "posterior": "posterior/posterior.nc", "draws": "posterior/draws.csv", "figures": "figures",
        "network": "calibration/hyperaemia.json", "report": "report.html",
    }.items():  # fmt: skip
        with pytest.raises(InputError) as caught:
            getattr(started, ask)
        assert str(caught.value).endswith(f"not computed yet; run the campaign, or its target results/smoke/{target}")
        assert "\n" not in str(caught.value)
    assert "not computed yet" in started._repr_html_()
    with pytest.raises(InputError, match="not the results folder of a campaign"):
        coronaryuq.open(tmp_path)
    with pytest.raises(InputError, match=r"did you mean campaign.yaml\?"):
        started.explain("campain.yaml")


def test_the_examples_of_the_notebook_page_run(results, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").symlink_to(results.parent)
    names: dict = {}
    *examples, _ = blocks("how-to/notebook.md")
    for block in examples:
        exec(compile(block, "notebook.md", "exec"), names)
    assert list(names["table"].columns[:2]) == ["name", "time"] and len(names["table"]) > 100


@pytest.mark.long
def test_the_search_of_the_notebook_page_runs(shared, tmp_path, monkeypatch):
    (tmp_path / "work").mkdir()
    (tmp_path / "shared").symlink_to(shared)
    monkeypatch.chdir(tmp_path / "work")
    names = {"coronaryuq": coronaryuq}
    exec(compile(blocks("how-to/notebook.md")[-1], "notebook.md", "exec"), names)
    assert names["answer"]["paragraph"] and Path("found", "discrepancy.json").is_file()


@pytest.fixture(scope="module")
def server(results):
    """Address of a server of the campaign's models, and the lines that it printed."""
    pytest.importorskip("umbridge", reason="needs umbridge, which is not installed")
    with served(results) as started:
        yield started


def test_the_examples_of_the_umbridge_page_run(server):
    url, lines = server
    assert any(line.startswith("flow3d: ") and line.endswith("up to 8 at once") for line in lines)
    names: dict = {}
    for block in blocks("how-to/umbridge.md"):
        exec(compile(block.replace("http://127.0.0.1:4242", url), "umbridge.md", "exec"), names)
    assert set(names["ffr"]) == {"ffr_lad", "ffr_lcx", "ffr_rca"}


@pytest.mark.parametrize(
    ("script", "package", "lines"), [("qmcpy_mean.py", "qmcpy", 3), ("tinyda_posterior.py", "tinyDA", 14)]
)
def test_the_examples_with_other_clients_run(server, results, script, package, lines):
    if subprocess.run([sys.executable, "-c", f"import {package}"], capture_output=True).returncode:
        pytest.skip(f"needs {package}, which is not installed")
    options = {"qmcpy": ["--samples", "8"], "tinyDA": [str(results), "--iterations", "20"]}[package]
    command = [sys.executable, str(ROOT / "examples" / script), server[0], *options]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len([line for line in done.stdout.splitlines() if line.startswith(("ffr_", "BC_"))]) == lines


def test_the_examples_in_the_help_run(results, tmp_path):
    (tmp_path / "results").symlink_to(results.parent)
    (tmp_path / "config").symlink_to(ROOT / "config")
    lines = [line for shown in EXAMPLES.values() for line, _ in shown if not NOT_RUN & set(line.split())]
    assert len(lines) >= 8
    for line in lines:
        command = line.replace("coronaryuq ", f"{shlex.quote(sys.executable)} -m coronaryuq.cli.main ", 1)
        done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, (line, done.stderr)


def test_the_commands_of_the_first_tutorial_run_and_more_0d_runs_repeat_no_3d_run(results, tmp_path):
    shutil.copytree(results.parents[1], tmp_path / "reader", symlinks=True)
    printed = follow("bundled-patient.md", tmp_path / "reader")
    jobs = dict(re.findall(r"^(\w+) +(\d+)$", printed, re.MULTILINE))
    assert jobs["zerod_chunk"] == "2" and not {"mesh", "flow3d_batch", "posterior_chains"} & set(jobs)
