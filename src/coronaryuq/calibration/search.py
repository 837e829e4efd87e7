"""Stage one's search: candidates, an approach by least squares from the best of them, then Nelder-Mead block by block.

Twenty targets cannot decide 36 parameters, and Nelder-Mead slows down with dimension. So the search goes block by block
(subspace searches as in Subplex, Rowan 1990), each block being the parameters that one group of targets speaks about; a
weak pull keeps parameters that no target speaks about at their published values.

The search takes coarse time steps. Before each round every start is run with the final steps too, and the difference of
the measures is added to the coarse ones for that round (defect correction), so that what is tuned is the final loop.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.calibration import parameters
from coronaryuq.calibration.least_squares_start import approach
from coronaryuq.calibration.loop import Loop
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.simplex import nelder_mead
from coronaryuq.calibration.targets import BY_NAME, misfits
from coronaryuq.core import seeds

FAILED = 1e9
"""Cost of a loop that has no periodic state."""

LIMIT, STEEPER = 2.0, 30.0
"""Beyond two tolerances, that is 4 %, the misfit of a clinical target costs so much more: all of them are to end within
5 %, which matters more than how closely the others are met when they contradict one another."""

UNDEFINED = 1e3
"""Misfit of a measure that does not exist, such as the timing of a valve that stays shut."""

EFFORT = {"filling": 0.5, "right": 0.3}
"""Share of the evaluations per parameter for blocks that few targets speak about."""

FIRST_STEP = 0.1
"""Size of a search's first simplex, as a fraction of the box; each later round takes half."""

Report = Callable[[str], None]


@dataclass(frozen=True)
class Found:
    """Where a start stands: its point (36,), cost, periodic state, and final minus coarse measures (defect)."""

    point: np.ndarray
    cost: float
    state: np.ndarray
    defect: Mapping[str, float] = field(default_factory=dict)


def residuals(
    measures: Mapping[str, np.ndarray], points: np.ndarray, targets: Mapping[str, float], pull: float
) -> np.ndarray:
    """Whose squares make the cost, (n, m): misfits, what clinical ones exceed `LIMIT` by, and the weak pull."""
    moved = (points - parameters.INITIAL) / (parameters.UPPER - parameters.LOWER)
    columns = list((np.sqrt(pull) * moved).T)
    for name, misfit in misfits(measures, targets).items():
        misfit = np.nan_to_num(misfit, nan=UNDEFINED)
        columns.append(misfit)
        if BY_NAME[name].clinical:
            columns.append(np.sqrt(STEEPER) * np.sign(misfit) * np.maximum(np.abs(misfit) - LIMIT, 0.0))
    return np.stack(columns, axis=1)


def cost(
    measures: Mapping[str, np.ndarray], points: np.ndarray, targets: Mapping[str, float], pull: float
) -> np.ndarray:
    """What a search lowers, (n,): the sum of squared residuals."""
    return np.square(residuals(measures, points, targets, pull)).sum(axis=1)


class Search:
    """Tunes one loop to one set of targets."""

    def __init__(
        self, loop: Loop, targets: Mapping[str, float], settings: Settings, report: Report = lambda line: None
    ):
        self.loop, self.targets, self.settings, self.report = loop, targets, settings, report

    def descend_from(self, found: list[Found], frozen: tuple[str, ...] = ()) -> Found:
        """The best point reached from the candidates; `frozen` parameters stay where they are."""
        kept = np.array([place for place, name in enumerate(parameters.NAMES) if name not in frozen])
        for turn in range(self.settings.rounds):
            found = self.corrected(found)
            if self.settings.approach:
                found = [self.approached(one, kept) for one in found]
                self.report(f"round {turn + 1}, least squares: cost {min(one.cost for one in found):.4g}")
            for block in parameters.BLOCKS:
                columns = np.intersect1d(parameters.columns(block), kept)
                spent = max(2, round(EFFORT.get(block, 1.0) * self.settings.evaluations_per_parameter))
                found = self.descend(found, columns, spent, FIRST_STEP / 2**turn)
                self.report(f"round {turn + 1}, {block}: cost {min(one.cost for one in found):.4g}")
        if self.settings.polish:
            found = self.corrected(found)
            first_step = FIRST_STEP / 2 ** (self.settings.rounds + 1)
            found = self.descend(found, kept, self.settings.polish, first_step)
            self.report(f"all together: cost {min(one.cost for one in found):.4g}")
        found = self.corrected(found)
        return min(found, key=lambda one: one.cost)

    def candidates(self, seed: int) -> list[Found]:
        """The best `starts` of the initial values and random parameter sets about them."""
        random = seeds.generator(seed, "calibration", "candidates")
        width = self.settings.spread * (parameters.UPPER - parameters.LOWER)
        shifts = random.uniform(-0.5, 0.5, (self.settings.candidates, len(parameters.NAMES)))
        points = np.clip(parameters.INITIAL + width * shifts, parameters.LOWER, parameters.UPPER)
        points[0] = parameters.INITIAL
        evaluation = self.loop.evaluate(points, cycles=self.settings.first_cycles)
        costs = self._costs(evaluation.measures, evaluation.ok, points)
        order = np.argsort(costs, kind="stable")[: self.settings.starts]
        self.report(f"{len(points)} candidates: cost {costs[order[0]]:.4g}, {int(evaluation.ok.sum())} ran")
        return [Found(points[i], float(costs[i]), evaluation.state[i]) for i in order]

    def settled(self, one: Found, block: str, frozen: tuple[str, ...]) -> Found:
        """One start with the block's parameters tuned again, after others were moved from outside."""
        kept = [place for place, name in enumerate(parameters.NAMES) if name not in frozen]
        columns = np.intersect1d(parameters.columns(block), kept)
        (one,) = self.corrected([one])
        if self.settings.approach:
            one = self.approached(one, columns)
        found = self.descend([one], columns, self.settings.evaluations_per_parameter, FIRST_STEP)
        self.report(f"{block} again: cost {found[0].cost:.4g}")
        return found[0]

    def approached(self, one: Found, columns: np.ndarray) -> Found:
        """One start after a few least-squares steps over the parameters at `columns`; counted scores stay out."""
        smooth = {name: value for name, value in self.targets.items() if not name.endswith("GradOK")}

        def of(values: np.ndarray) -> np.ndarray:
            points = np.tile(one.point, (len(values), 1))
            points[:, columns] = values
            evaluation = self.loop.evaluate(points, np.tile(one.state, (len(points), 1)), self.settings.approach_cycles)
            measures = {name: value + one.defect.get(name, 0.0) for name, value in evaluation.measures.items()}
            found = residuals(measures, points, smooth, self.settings.pull)
            return np.where(evaluation.ok[:, None], found, UNDEFINED)

        point = one.point.copy()
        point[columns] = approach(
            of, point[columns], parameters.LOWER[columns], parameters.UPPER[columns], self.settings.approach
        )
        evaluation = self.loop.evaluate(point[None], one.state[None], self.settings.first_cycles)
        measures = {name: value + one.defect.get(name, 0.0) for name, value in evaluation.measures.items()}
        found = float(self._costs(measures, evaluation.ok, point[None])[0])
        return replace(one, point=point, cost=found, state=evaluation.state[0]) if found < one.cost else one

    def corrected(self, found: list[Found]) -> list[Found]:
        """The same points with the cost that they have at the final time steps, and their defect."""
        points, states = np.array([one.point for one in found]), np.array([one.state for one in found])
        coarse = self.loop.evaluate(points, states, self.settings.first_cycles)
        fine = self.loop.evaluate(
            points, coarse.state, self.settings.first_cycles, steps_per_cycle=self.settings.final_steps_per_cycle
        )
        costs = self._costs(fine.measures, coarse.ok & fine.ok, points)
        defects = {name: fine.measures[name] - coarse.measures[name] for name in fine.measures}
        return [
            replace(
                one,
                cost=float(costs[row]),
                state=coarse.state[row],
                defect={name: float(np.nan_to_num(defect[row])) for name, defect in defects.items()},
            )
            for row, one in enumerate(found)
        ]

    def descend(self, found: list[Found], columns: np.ndarray, per_parameter: int, first_step: float) -> list[Found]:
        """Nelder-Mead over the parameters at `columns` from every start."""
        best = list(found)

        def objective(values: np.ndarray, which: np.ndarray) -> np.ndarray:
            points = np.array([found[start].point for start in which])
            points[:, columns] = values
            states = np.array([best[start].state for start in which])
            evaluation = self.loop.evaluate(points, states, self.settings.cycles)
            measures = {
                name: value + [found[start].defect.get(name, 0.0) for start in which]
                for name, value in evaluation.measures.items()
            }
            costs = self._costs(measures, evaluation.ok, points)
            for row, start in enumerate(which):
                if costs[row] < best[start].cost:
                    best[start] = replace(
                        best[start], point=points[row], cost=float(costs[row]), state=evaluation.state[row]
                    )
            return costs

        nelder_mead(
            objective,
            [one.point[columns] for one in found],
            parameters.LOWER[columns],
            parameters.UPPER[columns],
            first_step,
            per_parameter * len(columns),
            tolerance=1e-3,
        )
        return best

    def _costs(self, measures: Mapping[str, np.ndarray], ok: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.where(ok, cost(measures, points, self.targets, self.settings.pull), FAILED)
