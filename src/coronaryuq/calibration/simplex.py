"""Many Nelder-Mead searches at once: scipy's optimiser for each start, with evaluations gathered into batches.

Every start runs `scipy.optimize.minimize(method="Nelder-Mead")` unchanged in its own thread. When all threads that are
still searching have requested a value, their points are evaluated as one batch. A start therefore takes exactly the
path that it would take alone: the batch only makes the model cheaper.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

BatchObjective = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Values (k,) of points (k, d); the second argument gives the requesting starts, (k,) in rising order, each at most
once."""


@dataclass(frozen=True)
class Minimum:
    """Result of one start: its final point (d,), value there, and number of evaluations."""

    point: np.ndarray
    value: float
    evaluations: int


def nelder_mead(
    objective: BatchObjective,
    starts: Sequence[np.ndarray],
    lower: np.ndarray,
    upper: np.ndarray,
    first_step: float,
    evaluations: int,
    tolerance: float = 1e-4,
) -> list[Minimum]:
    """Minimise from every start (d,) within the box (Nelder & Mead 1965; coefficients by dimension, Gao & Han 2012).

    `first_step`: size of the first simplex as a fraction of the box, towards the farther wall. Each start makes at
    most `evaluations` (its first simplex takes d + 1) or stops when points and values of its simplex agree within
    `tolerance` (points as a fraction of the box). An objective that raises stops every start, and the error is raised
    here.
    """
    width = upper - lower
    gather = _Gather(objective, len(starts), lower, width)
    minima: list[Minimum | None] = [None] * len(starts)

    def search(start: int) -> None:
        try:
            first = np.clip((starts[start] - lower) / width, 0.0, 1.0)
            simplex = np.vstack([first, first + first_step * np.diag(np.where(first < 0.5, 1.0, -1.0))])
            result = minimize(
                lambda point: gather.value(start, point),
                first,
                method="Nelder-Mead",
                bounds=[(0.0, 1.0)] * len(first),
                options={
                    "initial_simplex": simplex,
                    "maxfev": evaluations,
                    "xatol": tolerance,
                    "fatol": tolerance,
                    "adaptive": True,
                },
            )
            minima[start] = Minimum(lower + width * result.x, float(result.fun), int(result.nfev))
        except _Stopped:
            pass
        finally:
            gather.leave(start)

    threads = [threading.Thread(target=search, args=(start,), daemon=True) for start in range(len(starts))]
    for thread in threads:
        thread.start()
    try:
        gather.serve()
    finally:
        for thread in threads:
            thread.join()
    return [minimum for minimum in minima if minimum is not None]


class _Stopped(Exception):
    """The objective failed for a batch: no start can continue."""


class _Gather:
    """Synchronisation of the searching threads and the evaluating one."""

    def __init__(self, objective: BatchObjective, starts: int, lower: np.ndarray, width: np.ndarray):
        self.objective, self.lower, self.width = objective, lower, width
        self.condition = threading.Condition()
        self.searching = set(range(starts))
        self.asked: dict[int, np.ndarray] = {}
        self.answers: dict[int, float] = {}
        self.failed = False

    def value(self, start: int, point: np.ndarray) -> float:
        with self.condition:
            self.asked[start] = self.lower + self.width * point
            self.condition.notify_all()
            self.condition.wait_for(lambda: start in self.answers or self.failed)
            if self.failed:
                raise _Stopped
            return self.answers.pop(start)

    def leave(self, start: int) -> None:
        with self.condition:
            self.searching.discard(start)
            self.condition.notify_all()

    def serve(self) -> None:
        """Evaluate batch after batch until no start is left."""
        while True:
            with self.condition:
                self.condition.wait_for(lambda: len(self.asked) == len(self.searching))
                if not self.searching:
                    return
                which = np.array(sorted(self.asked))
                points = np.array([self.asked[start] for start in which])
                self.asked.clear()
            try:
                values = self.objective(points, which)
            except BaseException:
                with self.condition:
                    self.failed = True
                    self.condition.notify_all()
                raise
            with self.condition:
                self.answers.update(zip(which.tolist(), map(float, values), strict=True))
                self.condition.notify_all()
