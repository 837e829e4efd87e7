"""Runs that several computations ask for, made side by side; each goes on when its own result is there.

One fit asks for a handful of runs at a time, which fill no group of lanes and no second thread; fits of five rivals do.
"""

from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.result import Result


@dataclass(frozen=True)
class Run:
    """One batch on an engine that a computation asks for. options: of `Engine.run`, but for its threads."""

    engine: Engine
    changes: dict
    options: dict

    def made(self, threads: int) -> Result:
        return self.engine.run(self.changes, threads=threads, **self.options)


T = TypeVar("T")
Asking = Generator[Run, Result, T]
"""A computation that yields a `Run`, is sent its `Result`, and so on, and returns what it is about."""


def side_by_side(computations: list[Asking[T]], threads: int) -> list[T]:
    """What the computations return, in their order.

    Each goes as far as its next run, and then they take turns: one that has its result goes on to its next run while
    those of others are made. They go on one by one, always in their order, so that states that they share do not
    depend on `threads`.
    """
    found: list[T | None] = [None] * len(computations)
    with ThreadPoolExecutor(threads) as drivers:
        beside = threads > 1 and len(computations) > 1
        asked: dict[int, Callable[[], Result]] = {}

        def go_on(number: int, result: Result | None) -> None:
            try:
                run = computations[number].send(result)
            except StopIteration as end:
                found[number] = end.value
            else:
                asked[number] = drivers.submit(run.made, threads).result if beside else partial(run.made, threads)

        for number in range(len(computations)):
            go_on(number, None)
        while asked:
            turn, asked = asked, {}
            for number, result in turn.items():
                go_on(number, result())
    return found
