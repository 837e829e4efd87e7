"""Meshing in a process of its own: death, delay and failure of an attempt are reported, and the next one is tried."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from coronaryuq.flow3d.mesh.generation import mmg_process
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from support import mesh_jobs


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Let the mesher's process import `support`."""
    monkeypatch.setenv("PYTHONPATH", str(Path(mesh_jobs.__file__).parents[1]), prepend=os.pathsep)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "limit", "message"),
    [
        (mesh_jobs.die, 30.0, r"attempt 1: the mesher was killed \(SIGSEGV\); attempt 2"),
        (mesh_jobs.compute_forever, 0.5, "not finished after 0.5 s of CPU time"),
        (mesh_jobs.sleep, 0.1, "stuck: not finished after 2 s"),
        (mesh_jobs.fail, 30.0, "ValueError: no idea"),
    ],
)
def test_the_reason_of_every_failure_is_reported(function, limit, message):
    with pytest.raises(MeshError, match=message):
        mmg_process.run("LAD", (function, {}), limit, attempts=2)


@pytest.mark.slow
def test_the_next_attempt_is_tried_and_the_failure_kept():
    piece, failures = mmg_process.run("LAD", (mesh_jobs.succeed_at_the_second_attempt, {}), 30.0, attempts=3)
    assert np.array_equal(piece.tets, mesh_jobs.TETRAHEDRON.tets)
    assert failures == ["attempt 1: first attempts never work"]


@pytest.mark.slow
def test_a_lower_cpu_limit_set_by_the_machine_is_kept():
    """A scheduler's limit of CPU time, below that of an attempt, in a process that has no other."""
    script = (
        "import resource; resource.setrlimit(resource.RLIMIT_CPU, (100, 100)); "
        "from coronaryuq.flow3d.mesh.generation import mmg_process; from support import mesh_jobs; "
        "job = mesh_jobs.succeed_at_the_second_attempt, {}; "
        "print(len(mmg_process.run('LAD', job, 600.0, attempts=2)[0].tets))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout == "1\n", done.stderr
