"""Closed loops, and changes of their parameters."""

import pytest

from coronaryuq.zerod.solver.engine import Engine
from support.zerod_networks import closed_loop


@pytest.fixture(scope="module")
def loop() -> Engine:
    return Engine(closed_loop())


@pytest.fixture(scope="module")
def fine_loop() -> Engine:
    """1000 steps per cycle resolve the valves well enough for cycle errors far below 1e-4."""
    return Engine(closed_loop(steps=1000))
