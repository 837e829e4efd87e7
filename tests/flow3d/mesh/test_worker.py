"""Meshing in a process of its own: death, delay and failure of an attempt are named, and the next one is tried."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from coronaryuq.flow3d.mesh.generation import mmg_process
from coronaryuq.flow3d.mesh.generation.piece import ATTEMPTS, Piece, check
from coronaryuq.flow3d.mesh.geometry.errors import MeshError

TETRAHEDRON = Piece(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 1, 2, 3]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    np.ones(4, int),
)


def dies(attempt):
    os.kill(os.getpid(), signal.SIGSEGV)


def sleeps(attempt):
    time.sleep(60)


def works_on(attempt):
    while True:
        pass


def raises(attempt):
    raise ValueError("no idea")


def second_time_lucky(attempt):
    if attempt == ATTEMPTS[0]:
        raise MeshError("first attempts never work")
    return TETRAHEDRON


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]), prepend=os.pathsep)


@pytest.mark.parametrize(
    ("function", "limit", "told"),
    [
        (dies, 30.0, r"attempt 1: the mesher was killed \(SIGSEGV\); attempt 2"),
        (works_on, 0.5, "not finished after 0.5 s of CPU time"),
        (sleeps, 0.1, "stuck: not finished after 2 s"),
        (raises, 30.0, "ValueError: no idea"),
    ],
)
def test_every_failure_is_named(function, limit, told):
    with pytest.raises(MeshError, match=told):
        mmg_process.run("LAD", (function, {}), limit, attempts=2)


def test_the_next_attempt_is_tried_and_the_failure_kept():
    piece, failures = mmg_process.run("LAD", (second_time_lucky, {}), 30.0, attempts=3)
    assert np.array_equal(piece.tets, TETRAHEDRON.tets)
    assert failures == ["attempt 1: first attempts never work"]


def test_a_limit_that_the_machine_sets_stays_and_is_no_obstacle():
    """A scheduler's limit of CPU time, below the one that an attempt would have, in a process that has no other."""
    told = (
        "import resource; resource.setrlimit(resource.RLIMIT_CPU, (100, 100)); "
        "import tests.flow3d.mesh.test_worker as t; "
        "print(len(t.mmg_process.run('LAD', (t.second_time_lucky, {}), 600.0, attempts=2)[0].tets))"
    )
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=False)
    assert done.stdout == "1\n", done.stderr


def test_bad_pieces_are_refused():
    check(TETRAHEDRON, [], enclosed=1 / 6)
    with pytest.raises(MeshError, match="volume"):
        check(TETRAHEDRON, [], enclosed=1.0)
    inverted = Piece(TETRAHEDRON.points, TETRAHEDRON.tets[:, [0, 2, 1, 3]], TETRAHEDRON.triangles, TETRAHEDRON.refs)
    with pytest.raises(MeshError, match="inverted"):
        check(inverted, [], enclosed=1 / 6)
    flat = Piece(TETRAHEDRON.points * [1, 1, 0.01], TETRAHEDRON.tets, TETRAHEDRON.triangles, TETRAHEDRON.refs)
    with pytest.raises(MeshError, match="dihedral"):
        check(flat, [], enclosed=1 / 600)
    two = Piece(
        np.vstack([TETRAHEDRON.points, TETRAHEDRON.points + 5]),
        np.vstack([TETRAHEDRON.tets, TETRAHEDRON.tets + 4]),
        np.vstack([TETRAHEDRON.triangles, TETRAHEDRON.triangles + 4]),
        np.ones(8, int),
    )
    with pytest.raises(MeshError, match="2 parts"):
        check(two, [], enclosed=1 / 3)
