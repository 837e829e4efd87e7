"""Runs that several computations ask for, made side by side; each goes on when its own result is there.

One fit asks for a handful of runs at a time, which fill no group of lanes and no second thread; fits of five rivals do.
"""

from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from coronaryuq.zerod.engine import Engine
from coronaryuq.zerod.result import Result


@dataclass(frozen=True)
class Run:
    """One batch on an engine that a computation asks for. options: of `Engine.run`, but for its threads."""

    engine: Engine
    changes: dict
    options: dict

    @property
    def samples(self) -> int:
        return max(len(values) for values in self.changes.values())

    def made(self, threads: int) -> Result:
        return self.engine.run(self.changes, threads=threads, **self.options)


T = TypeVar("T")
Asking = Generator[Run, Result, T]
"""A computation that yields a `Run`, is sent its `Result`, and so on, and returns what it is about."""


def side_by_side(computations: list[Asking[T]], threads: int) -> list[T]:
    """What the computations return, in their order.

    Each goes as far as its next run; all those runs are made together; and so on until none asks for more. Between
    runs they go on one by one, in their order: states that they share do not depend on `threads`.
    """
    found: list[T | None] = [None] * len(computations)
    asked: dict[int, Run] = {}

    def go_on(number: int, result: Result | None) -> None:
        try:
            asked[number] = computations[number].send(result)
        except StopIteration as end:
            found[number] = end.value

    for number in range(len(computations)):
        go_on(number, None)
    while asked:
        runs, asked = asked, {}
        for number, result in zip(runs, _made(list(runs.values()), threads), strict=True):
            go_on(number, result)
    return found


def _made(runs: list[Run], threads: int) -> list[Result]:
    if threads == 1 or len(runs) == 1:
        return [run.made(threads) for run in runs]
    # The largest go first, so that none is left to one thread at the end.
    order = sorted(range(len(runs)), key=lambda number: -runs[number].samples)
    with ThreadPoolExecutor(threads) as drivers:
        waiting = {number: drivers.submit(runs[number].made, threads) for number in order}
        return [waiting[number].result() for number in range(len(runs))]
