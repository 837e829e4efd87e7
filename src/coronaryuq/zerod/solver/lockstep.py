"""Computations that need solver runs, advanced together so that their runs execute in parallel.

A single fit needs a handful of runs at a time, which fill neither a group of lanes nor a second thread; five fits do.
"""

from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.result import Result


@dataclass(frozen=True)
class Run:
    """One batch on an engine that a computation needs. options: of `Engine.run_to_periodic`, except its threads."""

    engine: Engine
    changes: dict
    options: dict[str, Any]

    def execute(self, threads: int) -> Result:
        return self.engine.run_to_periodic(self.changes, threads=threads, **self.options)


T = TypeVar("T")
Computation = Generator[Run, Result, T]
"""A generator that yields each `Run` it needs, receives its `Result` and finally returns its value."""


def run_in_lockstep(computations: list[Computation[T]], threads: int) -> list[T]:
    """Return the values of all computations, in their order.

    Each advances to its next run; then they take turns: one continues with its result while the runs of the others
    execute. They always continue one at a time and in order, so that shared state does not depend on `threads`.
    """
    values: dict[int, T] = {}
    with ThreadPoolExecutor(threads) as pool:
        parallel = threads > 1 and len(computations) > 1
        pending: dict[int, Callable[[], Result]] = {}

        def advance(number: int, continue_: Callable[[], Run]) -> None:
            try:
                run = continue_()
            except StopIteration as end:
                values[number] = end.value
            else:
                pending[number] = (
                    pool.submit(run.execute, threads).result if parallel else partial(run.execute, threads)
                )

        for number, computation in enumerate(computations):
            advance(number, partial(next, computation))
        while pending:
            turn, pending = pending, {}
            for number, result in turn.items():
                advance(number, partial(computations[number].send, result()))
    return [values[number] for number in range(len(computations))]
