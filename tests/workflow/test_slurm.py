"""The campaign on a real SLURM: jobs submitted, MPI ranks by srun, the same results as without it."""

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
import yaml

from coronaryuq.cli import doctor
from coronaryuq.core.io.atomic import read_json
from support import cluster, smoke
from support.checkout import ROOT, Checkout, jobs_at_work

pytestmark = [pytest.mark.workflow]

TARGET = "results/small/posterior/summary.json"
SMALL = {
    "name": "small",
    "samples": {"n_3d": 8, "n_0d": 16, "chunk_0d": 8, "chunk_realisations": 20},
    "synthetic": {"cells": 3000},
    "perfusion": {"realisations": 40},
    "calibration": {"candidates": 4, "starts": 1, "rounds": 1, "evaluations_per_parameter": 2, "final_nelder_mead": 0},
    "losses": {"runs_3d": 0},
    "posterior": {"dream": {"chains": 12, "generations": 400}, "independence": {"draws": 20}},
}
ON_SLURM = [
    "--executor", "slurm", "--jobs", "8", "--slurm-status-command", "squeue", "--latency-wait", "20",
    "--slurm-init-seconds-before-status-checks", "1", "--seconds-between-status-checks", "2",
    "--default-resources", "mem_mb=2000", "runtime=10",
    "--set-resources", "posterior_chains:mpi=srun", "posterior_chains:tasks=3", "posterior_chains:mem_mb_per_cpu=2000",
]  # fmt: skip


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    reason = cluster.why_not()
    if reason:
        pytest.skip(reason)
    with cluster.cluster(tmp_path_factory.mktemp("slurm")) as running:
        yield running


@pytest.mark.long
def test_jobs_on_slurm_give_the_same_bits_as_jobs_here(slurm, tmp_path):
    results = []
    for name, arguments in (("here", []), ("slurm", ON_SLURM)):
        checkout = Checkout(tmp_path / name)
        done = checkout.run(TARGET, *arguments, settings=SMALL)
        assert done.returncode == 0, done.stdout + done.stderr
        draws = (checkout.folder / "results/small/posterior/draws.csv").read_bytes()
        targets = read_json(checkout.folder / "results/small/perfusion/targets.json")
        results.append((draws, json.dumps([targets["mean"], targets["covariance"]])))
    assert results[0] == results[1]
    listed = subprocess.run(["scontrol", "--oneliner", "show", "jobs"], capture_output=True, text=True).stdout
    assert listed.count("JobState=COMPLETED") >= 6, "every rule was a job of its own"


@pytest.mark.long
def test_the_whole_campaign_by_the_profile_gives_the_same_table(slurm, tmp_path):
    """A site's copy of the profile; other ranks, batches, chunks and threads than the campaign here."""
    site, here, there = tmp_path / "site", tmp_path / "here", tmp_path / "there"
    shutil.copytree(ROOT / "workflow" / "profiles" / "slurm", site)
    profile = yaml.safe_load((site / "config.yaml").read_text())
    profile["set-resources"]["posterior_chains"]["tasks"] = 3
    profile |= {"jobs": 8, "latency-wait": 20, "slurm-init-seconds-before-status-checks": 1}
    (site / "config.yaml").write_text(yaml.safe_dump(profile))
    here.mkdir()
    there.mkdir()
    table = ("--", "results/smoke/estimation/table.csv")
    alone = smoke.campaign(here, *table, more=(smoke.SMALLER,))
    spread = smoke.campaign(there, *table, profile=site, more=(smoke.SMALLER, smoke.OTHER_PORTIONS))
    assert not smoke.differences(alone, spread)
    assert read_json(spread / "provenance" / "posterior_chains-1.json")["resources"]["mpi_ranks"] == 3
    assert len(list(spread.glob("flow3d/batch_*.jsonl"))) == 4 and len(list(alone.glob("flow3d/batch_*.jsonl"))) == 3


def freeze(folder: Path) -> None:
    """The first attempt hangs, as on a file system that does not answer."""
    deadline = time.monotonic() + 120
    while not (hanging := jobs_at_work(folder, "perfusion_chunk")):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    for pid in hanging:
        os.kill(pid, signal.SIGSTOP)


def cancel(folder: Path) -> None:
    deadline = time.monotonic() + 120
    while not jobs_at_work(folder, "perfusion_chunk"):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    subprocess.run(["scancel", "--state=RUNNING", "--user=root"], check=True)


LIMITED = {
    "name": "small",
    "case": "given/case.yaml",
    "perfusion": {"realisations": 40},
    "samples": {"chunk_realisations": 40},
}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The perfusion targets of a campaign here."""
    checkout = Checkout(tmp_path_factory.mktemp("here"))
    checkout.small_case()
    target = "results/small/perfusion/targets.json"
    assert checkout.run(target, settings=LIMITED).returncode == 0
    return (checkout.folder / target).read_bytes()


@pytest.mark.long
@pytest.mark.parametrize(
    ("resource", "harm", "told"),
    [
        ("perfusion_chunk:mem_mb=60 * attempt ** 5", None, "Exceeded job memory limit"),
        ("perfusion_chunk:runtime=1 + 9 * (attempt - 1)", freeze, "DUE TO TIME LIMIT"),
        ("perfusion_chunk:mem_mb=2000", cancel, "CANCELLED AT"),
    ],
    ids=["memory", "time", "cancelled"],
)
def test_a_job_over_its_limit_is_run_again_with_more(slurm, undisturbed, tmp_path, resource, harm, told):
    checkout, target, out = Checkout(tmp_path), "results/small/perfusion/targets.json", tmp_path / "out.log"
    checkout.small_case()
    with open(out, "w") as log:
        command = checkout.command(target, *ON_SLURM, resource, "--retries", "2", settings=LIMITED)
        process = subprocess.Popen(**command, stdout=log, stderr=log)
        try:
            if harm:
                harm(tmp_path)
            assert process.wait(500) == 0, out.read_text()[-3000:]
        finally:
            process.kill()
    assert (tmp_path / target).read_bytes() == undisturbed
    assert "Trying to restart job" in out.read_text()
    logs = (tmp_path / ".snakemake" / "slurm_logs" / "rule_perfusion_chunk").rglob("*.log")
    assert told in "".join(log.read_text() for log in logs)


@pytest.mark.long
def test_a_node_that_goes_down_costs_time_and_nothing_else(slurm, tmp_path):
    """Its job is requeued, or fails and is run again, on the other node."""
    settings = {
        "name": "small", "case": "given/case.yaml", "perfusion": {"realisations": 2000},
        "samples": {"chunk_realisations": 2000},
    }  # fmt: skip
    target, found = "results/small/perfusion/targets.json", []
    for name in ("here", "slurm"):
        checkout = Checkout(tmp_path / name)
        checkout.small_case()
        if name == "here":
            assert checkout.run(target, settings=settings).returncode == 0
        else:
            process = subprocess.Popen(
                **checkout.command(target, *ON_SLURM, "--retries", "2", settings=settings),
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            node = slurm.node_at_work(120)
            slurm.kill_node(node)
            try:
                assert process.wait(400) == 0
            finally:
                process.kill()
                slurm.revive_node(node)
        found.append((checkout.folder / target).read_bytes())
    assert found[0] == found[1]


def test_doctor_runs_a_tiny_job_of_two_ranks(slurm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (found,) = doctor.check_scheduler()
    assert found.sound and "srun ran a job of 2 MPI ranks" in found.detail, found
    assert list(tmp_path.iterdir()) == []
