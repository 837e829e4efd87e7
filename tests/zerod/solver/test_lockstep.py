"""Computations that ask for runs get their own results, whatever else runs beside them and on how many threads."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.zerod.solver.lockstep import Run, run_in_lockstep


class Doubling:
    """An "engine" that doubles a number; runs may have to wait until so many that do are under way together."""

    def __init__(self, together=1):
        self.barrier = threading.Barrier(together)

    def run_to_periodic(self, changes, threads, wait=False):
        if wait:
            self.barrier.wait(timeout=30.0)
        return SimpleNamespace(value=2.0 * changes["x"])


def repeated(engine, start, times, log, **options):
    """Double a number so often, one run each."""
    x = np.full(3, float(start))
    for turn in range(times):
        log.append((start, turn))
        result = yield Run(engine, {"x": x}, options)
        x = result.value
    return x[0]


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
def test_each_computation_gets_its_own_results_in_order(threads):
    log, engine = [], Doubling()
    asking = [repeated(engine, start, times, log) for start, times in ((1, 3), (5, 0), (7, 1), (3, 2))]
    assert run_in_lockstep(asking, threads) == [8.0, 5.0, 14.0, 12.0]
    assert log == [(1, 0), (7, 0), (3, 0), (1, 1), (3, 1), (1, 2)]


def test_runs_of_one_round_execute_in_parallel():
    engine = Doubling(together=2)
    assert run_in_lockstep([repeated(engine, start, 2, [], wait=True) for start in (1, 2)], 2) == [4.0, 8.0]


def test_a_computation_continues_while_the_run_of_another_executes():
    engine = Doubling(together=2)

    def in_two_steps():
        yield Run(engine, {"x": 1.0}, {})
        return (yield Run(engine, {"x": 2.0}, {"wait": True})).value

    assert run_in_lockstep([in_two_steps(), repeated(engine, 5, 1, [], wait=True)], 2) == [4.0, 10.0]


def test_no_computations_give_no_values():
    assert run_in_lockstep([], 2) == []


def test_an_error_in_a_run_is_raised():
    class Broken:
        def run_to_periodic(self, changes, threads):
            raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        run_in_lockstep([repeated(Doubling(), 1, 1, []), repeated(Broken(), 2, 1, [])], 2)
