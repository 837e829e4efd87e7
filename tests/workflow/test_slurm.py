"""The campaign on a real SLURM: jobs submitted, MPI ranks by srun, the same results as without it."""

import json
import subprocess

import pytest

import cluster
from checkout import Checkout
from coronaryuq import doctor
from coronaryuq.files import read_json

pytestmark = [pytest.mark.workflow]

TARGET = "results/small/posterior/summary.json"
SMALL = {
    "name": "small",
    "samples": {"n_3d": 8, "n_0d": 16, "chunk_0d": 8, "chunk_realisations": 20},
    "synthetic": {"cells": 3000},
    "perfusion": {"realisations": 40},
    "calibration": {"candidates": 4, "starts": 1, "rounds": 1, "evaluations_per_parameter": 2, "polish": 0},
    "posterior": {"dream": {"chains": 12, "generations": 40}},
}
ON_SLURM = [
    "--executor", "slurm", "--jobs", "8", "--slurm-status-command", "squeue", "--latency-wait", "20",
    "--slurm-init-seconds-before-status-checks", "1", "--seconds-between-status-checks", "2",
    "--default-resources", "mem_mb=500", "runtime=10",
    "--set-resources", "posterior_chains:mpi=srun", "posterior_chains:tasks=3", "posterior_chains:mem_mb_per_cpu=500",
]  # fmt: skip


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    reason = cluster.why_not()
    if reason:
        pytest.skip(reason)
    with cluster.cluster(tmp_path_factory.mktemp("slurm")) as running:
        yield running


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
    (found,) = doctor._scheduler()
    assert found.sound and "a job of 2 MPI ranks ran by srun" in found.detail, found
    assert list(tmp_path.iterdir()) == []
