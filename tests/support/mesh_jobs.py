"""Meshing jobs that die, hang or fail, to be run in a process of their own."""

import os
import signal
import time

import numpy as np

from coronaryuq.flow3d.mesh.generation.piece import ATTEMPTS, Piece
from coronaryuq.flow3d.mesh.geometry.errors import MeshError

TETRAHEDRON = Piece(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 1, 2, 3]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    np.ones(4, int),
)


def die(attempt):
    os.kill(os.getpid(), signal.SIGSEGV)


def sleep(attempt):
    time.sleep(60)


def compute_forever(attempt):
    while True:
        pass


def fail(attempt):
    raise ValueError("no idea")


def succeed_at_the_second_attempt(attempt):
    if attempt == ATTEMPTS[0]:
        raise MeshError("first attempts never work")
    return TETRAHEDRON
