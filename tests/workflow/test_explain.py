"""`coronaryuq explain`: what a job wrote down about its results, and the command that makes them again."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from coronaryuq.campaign import explain
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from support.checkout import Checkout

pytestmark = pytest.mark.workflow

SETTINGS = {
    "name": "small",
    "case": "given/case.yaml",
    "samples": {"chunk_realisations": 20},
    "perfusion": {"realisations": 20},
}
TARGETS = "results/small/perfusion/targets.json"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    checkout = Checkout(tmp_path_factory.mktemp("explained"))
    checkout.small_case()
    done = checkout.run(TARGETS, settings=SETTINGS)
    assert done.returncode == 0, done.stdout + done.stderr
    return checkout.folder


def said(campaign: Path, result: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "coronaryuq.cli.main", "explain", result]
    environment = os.environ | {"PYTHONPATH": str(campaign / "src")}
    return subprocess.run(command, cwd=campaign, env=environment, capture_output=True, text=True)


def test_a_result_tells_its_code_settings_seed_libraries_inputs_and_machine(campaign):
    done = said(campaign, TARGETS)
    assert done.returncode == 0, done.stderr
    for word in ("made by     perfusion", "code digest", "numpy 2", os.uname().nodename, "correlation_length: 1.0"):
        assert word in done.stdout
    assert "results/small/perfusion/chunk_0.npz" in done.stdout
    assert "seed: 20241117" in said(campaign, "results/small/perfusion/chunk_0.npz").stdout


def test_every_file_of_the_campaign_is_some_jobs_result(campaign):
    home = campaign / "results" / "small"
    apart = (home / "logs", home / explain.FOLDER)
    files = [path for path in home.rglob("*") if path.is_file() and not any(a in path.parents for a in apart)]
    results = [path for path in files if path.name not in explain.OF_THE_CAMPAIGN]
    assert len(results) == 9
    for path in results:
        assert explain.explain(path).unchanged, path


def test_the_command_makes_the_same_bytes_again(campaign):
    before = (campaign / TARGETS).read_bytes()
    made = str(explain.explain(campaign / TARGETS)).partition("made by ")[2].splitlines()[0]
    command = said(campaign, TARGETS).stdout.splitlines()[-1]
    (campaign / TARGETS).write_text("lost")
    done = subprocess.run(
        ["bash", "-c", command], env=os.environ | {"PYTHONPATH": str(campaign / "src")}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (campaign / TARGETS).read_bytes() == before
    again = explain.explain(campaign / TARGETS)
    assert again.unchanged and str(again).partition("made by ")[2].splitlines()[0] >= made


def printed(campaign: Path, *words: str) -> tuple[int, dict]:
    """Exit code and JSON of a command."""
    command = [sys.executable, "-m", "coronaryuq.cli.main", *words, "--json"]
    environment = os.environ | {"PYTHONPATH": str(campaign / "src")}
    done = subprocess.run(command, cwd=campaign, env=environment, capture_output=True, text=True)
    return done.returncode, json.loads(done.stdout)


def test_the_json_says_the_same(campaign):
    code, told = printed(campaign, "explain", TARGETS)
    assert code == 0 and told["unchanged"] and told["result"] == TARGETS and told["job"] == "perfusion"
    assert told["inputs"]["results/small/perfusion/chunk_0.npz"] == "unchanged"
    assert told["command"] == said(campaign, TARGETS).stdout.splitlines()[-1].strip()
    code, verified = printed(campaign, "verify", "results/small")
    assert code == 0 and verified["changed"] == [] and verified["missing"] == [] and not verified["removed"]
    assert verified["verified"] == sum(verified["by_folder"].values()) == 9 and verified["jobs"] == 3
    whole = (campaign / TARGETS).read_bytes()
    (campaign / TARGETS).write_bytes(whole[:-1])
    try:
        code, told = printed(campaign, "explain", TARGETS)
        assert code == 1 and not told["unchanged"]
        code, verified = printed(campaign, "verify", "results/small")
        assert code == 1 and verified["changed"] == [str(campaign / TARGETS)]
    finally:
        (campaign / TARGETS).write_bytes(whole)


def test_an_altered_result_and_an_altered_input_are_reported(campaign):
    chunk = campaign / "results/small/perfusion/chunk_0.npz"
    whole = chunk.read_bytes()
    chunk.write_bytes(whole[:-1])
    try:
        altered = explain.explain(chunk)
        assert not altered.unchanged and "CHANGED since its job wrote it" in str(altered)
        assert "chunk_0.npz  (has changed since)" in str(explain.explain(campaign / TARGETS))
        assert said(campaign, str(chunk)).returncode == 1
    finally:
        chunk.write_bytes(whole)


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("results/small/none.json", "results/small/none.json: no such file; run the campaign that makes it"),
        ("small.yaml", "small.yaml: not a result: it is in no campaign's folder, results/NAME"),
        ("results/small/campaign.yaml", "name a file that a job wrote"),
        ("results/small/provenance/case.json", "a note about results; name one of the results"),
        ("results/small/case/stray.csv", "mentions this file; regenerate it"),
    ],
)
def test_what_is_no_result_is_one_line(campaign, path, line):
    if path not in ("results/small/none.json",) and not (campaign / path).exists():
        (campaign / path).write_text("")
    done = said(campaign, path)
    assert done.returncode == 2 and done.stdout == ""
    assert len(done.stderr.splitlines()) == 1 and line in done.stderr


def test_a_broken_note_is_one_line(campaign):
    note = campaign / "results/small/provenance/case.json"
    whole = note.read_text()
    note.write_text("{}")
    try:
        with pytest.raises(InputError, match="not a job's note"):
            explain.explain(campaign / TARGETS)
    finally:
        note.write_text(whole)


@pytest.mark.long
def test_a_result_from_the_cache_brings_its_note(tmp_path):
    (tmp_path / "cache").mkdir()
    for name in ("first", "second"):
        checkout = Checkout(tmp_path / name, tmp_path / "cache")
        checkout.small_case()
        done = checkout.run("results/small/perfusion/chunk_0.npz", settings=SETTINGS)
        assert done.returncode == 0, done.stdout + done.stderr
    second = tmp_path / "second" / "results/small"
    assert not (second / explain.FOLDER / "perfusion_chunk-0.json").exists(), "its job did not run here"
    origin = explain.explain(second / "perfusion/chunk_0.npz")
    assert (
        origin.unchanged and "made by     perfusion_chunk 0" in str(origin) and "taken from  the cache" in str(origin)
    )


def test_the_whole_configuration_is_kept_and_valid(campaign):
    from coronaryuq import config

    kept = config.load(campaign / "results/small" / explain.CAMPAIGN)
    assert kept == config.Campaign(**SETTINGS)
    note = read_json(campaign / "results/small/provenance/perfusion.json")
    assert note["params"]["settings"] == kept.perfusion.model_dump(mode="json")
