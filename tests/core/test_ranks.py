"""Ranks are those that the job was told of, not those that variables of an outer launcher speak of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import coronaryuq
from coronaryuq.core import launcher
from coronaryuq.core.errors import InputError
from coronaryuq.core.ranks import Ranks

OUTER = {
    "PMI_RANK": "1", "PMI_SIZE": "2", "PMI_FD": "7", "PMIX_RANK": "1", "PMIX_NAMESPACE": "outer",
    "OMPI_COMM_WORLD_RANK": "1", "OMPI_COMM_WORLD_SIZE": "2", "MPI_LOCALRANKID": "1", "SLURM_PROCID": "1",
    "SLURM_NTASKS": "2", "SLURM_STEP_NUM_TASKS": "2",
}  # fmt: skip
ALLOCATION = {
    "SLURM_JOB_ID": "7", "SLURM_JOBID": "7", "SLURM_NNODES": "2", "SLURM_JOB_NUM_NODES": "2", "SLURM_NODELIST": "a,b",
    "SLURM_JOB_NODELIST": "a,b", "SLURM_TASKS_PER_NODE": "1(x2)", "PBS_JOBID": "7", "PBS_NODEFILE": "/nowhere",
    "PBS_ENVIRONMENT": "PBS_BATCH", "LSB_JOBID": "7", "LSB_HOSTS": "a b", "PE_HOSTFILE": "/nowhere",
}  # fmt: skip
COUNT = "from coronaryuq.core.ranks import Ranks; r = Ranks.started(2); print(r.rank, r.size)"


def test_a_job_without_mpi_is_alone_whatever_the_environment_says(monkeypatch):
    for name, value in OUTER.items():
        monkeypatch.setenv(name, value)
    assert (Ranks.started(1).rank, Ranks.started(1, 3).threads) == (0, 3)
    assert Ranks.by_hand(False).size == 1


def test_by_hand_one_is_told_of_the_option(monkeypatch, capsys):
    monkeypatch.setenv("PMI_RANK", "0")
    Ranks.by_hand(False)
    assert "--mpi" in capsys.readouterr().err


def test_another_number_of_ranks_than_started_is_one_line():
    with pytest.raises(InputError, match=r"^MPI: ranks = 1: the launcher was told to start 24"):
        Ranks.started(24)


@pytest.mark.slow
def test_ranks_start_here_inside_an_allocation_and_a_step_of_srun():
    if not Path(sys.executable).with_name("mpiexec").exists():
        pytest.skip("needs mpiexec beside python")
    here = {"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "PYTHONPATH": Path(coronaryuq.__file__).parents[1]}
    line = f"set -euo pipefail; {launcher.FORGET_OUTER_RANKS}; {launcher.LOCAL_MPIEXEC} -n 2 python -c '{COUNT}'"
    done = subprocess.run(
        ["bash", "-c", line], env=os.environ | OUTER | ALLOCATION | here, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert sorted(filter(str.isdigit, done.stdout)) == ["0", "1", "2", "2"], "both ranks write at once"


def test_programs_started_here_are_no_ranks_of_an_outer_launcher(monkeypatch):
    for name, value in OUTER.items():
        monkeypatch.setenv(name, value)
    assert not {"PMI_RANK", "PMIX_NAMESPACE", "OMPI_COMM_WORLD_RANK", "MPI_LOCALRANKID"} & launcher.environment().keys()
    assert launcher.environment()["SLURM_PROCID"] == "1"
