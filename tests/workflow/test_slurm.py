"""The campaign on a real SLURM: jobs submitted, MPI ranks by srun, the same results as without it."""

import json
import subprocess

import pytest

import cluster
from checkout import Checkout
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
