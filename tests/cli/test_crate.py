"""`coronaryuq crate`: a campaign as an RO-Crate, valid, complete, and the same bytes every time."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from coronaryuq.cli.crate import METADATA
from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json
from support import crate_validator
from support.checkout import Checkout

pytestmark = [pytest.mark.workflow, pytest.mark.slow]

HOME = "results/small"
SETTINGS = {
    "name": "small",
    "case": "../given here/case.yaml",
    "samples": {"chunk_realisations": 20},
    "perfusion": {"realisations": 20},
}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """The folder in which a campaign ran on a patient from outside it."""
    checkout = Checkout(tmp_path_factory.mktemp("packed") / "work")
    shutil.move(Path(checkout.folder, checkout.small_case()).parent, checkout.folder.parent / "given here")
    done = checkout.run(f"{HOME}/perfusion/targets.json", settings=SETTINGS)
    assert done.returncode == 0, done.stdout + done.stderr
    return checkout.folder


@pytest.fixture
def altered(campaign, tmp_path):
    """A copy of the campaign and its patient, to change."""
    shutil.copytree(campaign.parent, tmp_path / "copy", ignore=shutil.ignore_patterns(".snakemake"))
    return tmp_path / "copy" / campaign.name


def pack(campaign: Path, *arguments, seed: int = 0) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "coronaryuq.cli.main", "crate", HOME, *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": str(campaign / "src"), "PYTHONHASHSEED": str(seed)}
    return subprocess.run(command, cwd=campaign, env=environment, capture_output=True, text=True)


@pytest.fixture(scope="module")
def crate(campaign, tmp_path_factory):
    """The crate as a folder, made by a named person."""
    out = tmp_path_factory.mktemp("crates") / "small"
    done = pack(campaign, "--out", out, "--agent", "Ada Example", "--orcid", "https://orcid.org/0000-0002-1825-0097")
    assert done.returncode == 0 and done.stdout == f"Crate: {out}\n", done.stderr
    return out


def graph(metadata: dict) -> dict:
    return {entity["@id"]: entity for entity in metadata["@graph"]}


def ids(values) -> set:
    return {value["@id"] for value in (values if isinstance(values, list) else [values])}


def test_the_same_campaign_gives_the_same_bytes(campaign, tmp_path):
    for seed in (1, 2):
        assert pack(campaign, "--out", tmp_path / f"{seed}.zip", seed=seed).returncode == 0
    assert (tmp_path / "1.zip").read_bytes() == (tmp_path / "2.zip").read_bytes()


def test_a_file_and_a_folder_hold_the_same(campaign, crate, tmp_path):
    assert pack(campaign, "--out", tmp_path / "a.zip").returncode == 0
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert archive.testzip() is None
        names = set(archive.namelist())
    there = {path.relative_to(crate).as_posix() for path in crate.rglob("*") if path.is_file()}
    assert names == there
    assert {"LICENSE", "CITATION.cff", "workflow/Snakefile", "workflow/rules/patient.smk"} <= names
    assert {f"{HOME}/campaign.yaml", f"{HOME}/perfusion/targets.json", "inputs/case.yaml"} <= names
    assert list(crate.parent.iterdir()) == [crate], "nothing is left beside it"


def test_checksums_in_the_metadata_are_those_of_the_files(crate):
    entities = graph(read_json(crate / METADATA))
    told = {name: entity["sha256"] for name, entity in entities.items() if "sha256" in entity}
    assert f"{HOME}/perfusion/chunk_0.npz" in told and "inputs/case.yaml" in told
    for name, content in told.items():
        assert provenance.checksum(crate / name) == content, name


def test_every_job_is_an_action_with_what_its_note_says(campaign, crate):
    entities = graph(read_json(crate / METADATA))
    notes = [read_json(path) for path in (campaign / HOME / "provenance").glob("*.json")]
    jobs = {name for name in entities if name.startswith("#job/")}
    assert len(jobs) == len(notes) >= 3
    assert {entity["object"]["@id"] for entity in entities.values() if entity["@type"] == "ControlAction"} == jobs
    for note in notes:
        action = entities["#job/" + note["job"].replace(" ", "%20")]
        assert ids(action["result"]) == set(note["results"])
        assert {name for name in note["inputs"] if name.startswith("results/")} <= ids(action["object"])
        assert action["endTime"] == note["made"] >= action["startTime"]
        assert action["agent"] == {"@id": "https://orcid.org/0000-0002-1825-0097"}
        assert entities[action["instrument"]["@id"]]["name"] == note["params"]["function"]
    (chunk,) = (note for note in notes if note["job"] == "perfusion_chunk 0")
    values = [
        entities[name] for name in ids(entities["#job/perfusion_chunk%200"]["object"]) if name.startswith("#value")
    ]
    told = {value["name"]: value["value"] for value in values}
    assert told["seed"] == str(chunk["params"]["seed"])
    assert json.loads(told["settings"]) == chunk["params"]["settings"]


def test_without_data_inputs_and_results_are_described_only(campaign, crate, tmp_path):
    assert pack(campaign, "--no-data", "--out", tmp_path / "small").returncode == 0
    entities = graph(read_json(tmp_path / "small" / METADATA))
    absent = entities[f"#{HOME}/perfusion/targets.json"]
    assert absent["sha256"] == provenance.checksum(campaign / HOME / "perfusion/targets.json")
    assert not (tmp_path / "small" / HOME / "perfusion").exists() and not (tmp_path / "small" / "inputs").exists()
    assert entities.keys() & {f"#job/{name}" for name in ("case", "perfusion")} == {"#job/case", "#job/perfusion"}


@pytest.mark.skipif(shutil.which(crate_validator.PROGRAM) is None, reason="needs roc-validator; see envs/tools.txt")
@pytest.mark.parametrize("arguments", [(), ("--no-data",)], ids=["whole", "without data"])
def test_the_crate_is_a_valid_provenance_run_crate(campaign, tmp_path, arguments):
    out = tmp_path / "small"
    assert pack(campaign, "--out", out, *arguments).returncode == 0
    done = crate_validator.validate(out, "provenance-run-crate-0.5", tmp_path)
    assert done.returncode == 0, done.stdout
    metadata = read_json(out / METADATA)
    del graph(metadata)["#campaign"]["instrument"]
    (out / METADATA).write_text(json.dumps(metadata))
    done = crate_validator.validate(out, "provenance-run-crate-0.5", tmp_path)
    assert done.returncode != 0 and "OrganizeAction" in done.stdout, "the validator finds a fault"


def refused(campaign: Path, line: str, *arguments) -> None:
    done = pack(campaign, *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and line in done.stderr, done.stderr
    assert not list(campaign.glob("*.zip"))


def test_an_altered_result_is_one_line(altered):
    (altered / HOME / "perfusion/targets.json").write_text("{}")
    refused(altered, "targets.json: changed since its job wrote it")


def test_an_altered_or_missing_input_is_one_line(altered):
    table = altered.parent / "given here" / "case.yaml"
    table.write_text(table.read_text() + "\n")
    refused(altered, "case.yaml: changed since case read it; run the campaign again")
    table.unlink()
    refused(altered, "case.yaml: an input of case that is no longer there")


def test_a_folder_that_is_no_campaign_is_one_line(altered):
    shutil.rmtree(altered / HOME / "provenance")
    refused(altered, "name the results folder of a campaign")


def test_a_folder_with_files_is_not_overwritten(altered):
    refused(altered, "already there; name a new folder", "--out", ".")


def test_an_orcid_is_a_persons(campaign):
    refused(campaign, "give --agent NAME", "--orcid", "https://orcid.org/0000-0002-1825-0097")
