"""Stage one's search: candidates, then Nelder-Mead over blocks of parameters from the best of them, then over all 36.

Twenty targets cannot decide 36 parameters, and Nelder-Mead slows down with dimension. So the search goes block by block
(subspace searches as in Subplex, Rowan 1990), each block being the parameters that one group of targets speaks about; a
weak pull keeps parameters that no target speaks about at their published values.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from coronaryuq import seeds
from coronaryuq.calibration import parameters
from coronaryuq.calibration.loop import Loop
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.simplex import nelder_mead
from coronaryuq.calibration.targets import misfits

FAILED = 1e9
"""Cost of a loop that has no periodic state."""

FIRST_STEP = 0.15
"""Size of a search's first simplex, as a fraction of the box; each later round takes half."""

Report = Callable[[str], None]


@dataclass
class Found:
    """Where a start stands: its point (36,), cost and periodic state (unknowns,)."""

    point: np.ndarray
    cost: float
    state: np.ndarray


def cost(
    measures: Mapping[str, np.ndarray], points: np.ndarray, targets: Mapping[str, float], pull: float
) -> np.ndarray:
    """Sum over targets of squared misfits plus the weak pull to the initial values, (n,)."""
    total = sum(np.square(np.nan_to_num(misfit, nan=1e3)) for misfit in misfits(measures, targets).values())
    moved = (points - parameters.INITIAL) / (parameters.UPPER - parameters.LOWER)
    return total + pull * np.square(moved).sum(axis=1)


class Search:
    """Tunes one loop to one set of targets."""

    def __init__(
        self, loop: Loop, targets: Mapping[str, float], settings: Settings, report: Report = lambda line: None
    ):
        self.loop, self.targets, self.settings, self.report = loop, targets, settings, report

    def descend_from(self, found: list[Found], frozen: tuple[str, ...] = ()) -> Found:
        """The best point reached from the candidates; `frozen` parameters stay where they are."""
        kept = [place for place in range(len(parameters.NAMES)) if parameters.NAMES[place] not in frozen]
        for turn in range(self.settings.rounds):
            for block in parameters.BLOCKS:
                columns = np.intersect1d(parameters.columns(block), kept)
                self.descend(found, columns, self.settings.evaluations_per_parameter, FIRST_STEP / 2**turn)
                self.report(f"round {turn + 1}, {block}: cost {min(one.cost for one in found):.4g}")
            found = sorted(found, key=lambda one: one.cost)[: max(1, (len(found) + 1) // 2)]
        if self.settings.polish:
            found = found[:1]
            self.descend(found, np.array(kept), self.settings.polish, FIRST_STEP / 2 ** (self.settings.rounds + 1))
            self.report(f"all together: cost {found[0].cost:.4g}")
        return found[0]

    def candidates(self, seed: int) -> list[Found]:
        """The best `starts` of the initial values and random parameter sets about them."""
        random = seeds.generator(seed, "calibration", "candidates")
        width = self.settings.spread * (parameters.UPPER - parameters.LOWER)
        points = parameters.INITIAL + width * random.uniform(
            -0.5, 0.5, (self.settings.candidates, len(parameters.NAMES))
        )
        points[0] = parameters.INITIAL
        points = np.clip(points, parameters.LOWER, parameters.UPPER)
        evaluation = self.loop.evaluate(points, cycles=self.settings.first_cycles)
        costs = self._costs(evaluation, points)
        order = np.argsort(costs, kind="stable")[: self.settings.starts]
        self.report(f"{len(points)} candidates: cost {costs[order[0]]:.4g}, {int(evaluation.ok.sum())} ran")
        return [Found(points[i], float(costs[i]), evaluation.state[i]) for i in order]

    def descend(self, found: list[Found], columns: np.ndarray, per_parameter: int, first_step: float) -> None:
        """Nelder-Mead over the parameters at `columns` from every start, in place."""

        def objective(values: np.ndarray, which: np.ndarray) -> np.ndarray:
            points = np.array([found[start].point for start in which])
            points[:, columns] = values
            states = np.array([best[start].state for start in which])
            evaluation = self.loop.evaluate(points, states, cycles=self.settings.cycles)
            costs = self._costs(evaluation, points)
            for row, start in enumerate(which):
                if costs[row] < best[start].cost:
                    best[start] = Found(points[row], float(costs[row]), evaluation.state[row])
            return costs

        best = list(found)
        nelder_mead(
            objective,
            [one.point[columns] for one in found],
            parameters.LOWER[columns],
            parameters.UPPER[columns],
            first_step,
            per_parameter * len(columns),
            tolerance=1e-3,
        )
        found[:] = best

    def _costs(self, evaluation, points: np.ndarray) -> np.ndarray:
        costs = cost(evaluation.measures, points, self.targets, self.settings.pull)
        return np.where(evaluation.ok, costs, FAILED)
