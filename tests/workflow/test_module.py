"""The workflow as a module of another Snakemake workflow."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from coronaryuq.core.io.atomic import read_json
from support.case_files import small_tree, write_case
from support.checkout import ROOT
from support.warm_snakemake import snakemake

pytestmark = [pytest.mark.workflow, pytest.mark.slow]

ONE = """
module coronaryuq:
    snakefile: "{snakefile}"
    config: config

use rule * from coronaryuq
"""
TWO = """
module first:
    snakefile: "{snakefile}"
    config: config["first"]

use rule * from first as first_*

module second:
    snakefile: "{snakefile}"
    config: config["second"]

use rule * from second as second_*

rule both:
    default_target: True
    input:
        expand("results/{{name}}/case/case.json", name=["one", "two"]),
"""


def run(folder: Path, text: str, settings: dict, *arguments: str) -> subprocess.CompletedProcess:
    """Run a user's workflow, with patients in `given/NAME`, in a folder of its own."""
    (folder / "Snakefile").write_text(text.format(snakefile=ROOT / "workflow" / "Snakefile"))
    (folder / "config.yaml").write_text(yaml.safe_dump(settings))
    for name in ("one", "two"):
        write_case(folder / "given" / name, small_tree())
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "XDG_CACHE_HOME": str(folder / "cache")}
    done = snakemake(["--configfile", "config.yaml", "--cores", "2", *arguments], folder, environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def settings(name: str) -> dict:
    return {"name": name, "case": f"given/{name}/case.yaml"}


def test_all_rules_are_those_of_the_users_workflow(tmp_path):
    target = "results/one/case/case.json"
    planned = run(tmp_path, ONE, settings("one"), "--dry-run", "results/one/report.html")
    assert "rule posterior_chains:" in planned.stdout + planned.stderr
    run(tmp_path, ONE, settings("one"), target)
    assert read_json(tmp_path / target)
    note = read_json(tmp_path / "results/one/provenance/case.json")
    assert note["snakefile"] == str(tmp_path / "Snakefile"), "by which `coronaryuq explain` makes it again"
    assert (tmp_path / "results/one/campaign.yaml").is_file()


def test_two_patients_are_two_modules_with_prefixed_rules(tmp_path):
    both = {"first": settings("one"), "second": settings("two")}
    run(tmp_path, TWO, both)
    for name, rule in (("one", "first_case"), ("two", "second_case")):
        assert read_json(tmp_path / f"results/{name}/case/case.json")
        assert read_json(tmp_path / f"results/{name}/provenance/{rule}.json")["job"] == rule
        kept = yaml.safe_load((tmp_path / f"results/{name}/campaign.yaml").read_text())
        assert kept["name"] == name and kept["case"] == f"given/{name}/case.yaml"


@pytest.mark.skipif(shutil.which("snakedeploy") is None, reason="needs snakedeploy; see envs/tools.txt")
def test_snakedeploy_makes_a_project_that_plans_the_campaign(tmp_path):
    """A clone has these parts; a repository on disk is deployed with a relative path, so its own is put there."""
    repository, project = tmp_path / "coronaryuq", tmp_path / "project"
    for part in ("workflow", "config"):
        shutil.copytree(ROOT / part, repository / part, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "LICENSE", repository)
    command = ["snakedeploy", "deploy-workflow", str(repository), str(project), "--branch", "main"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (project / "LICENSE").is_file() and (project / "config/README.md").is_file()
    deployed = project / "workflow" / "Snakefile"
    text = deployed.read_text()
    assert 'configfile: "config/config.yaml"' in text and '"workflow/Snakefile"' in text
    deployed.write_text(text.replace('"workflow/Snakefile"', f'"{ROOT / "workflow" / "Snakefile"}"'))
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    planned = snakemake(["--cores", "2", "--dry-run"], project, environment)
    assert planned.returncode == 0, planned.stdout + planned.stderr
    assert "results/campaign/report.html" in planned.stdout + planned.stderr
