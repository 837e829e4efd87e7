"""The search for the loop's parameters: candidates, least squares from the best of them, then Nelder-Mead by blocks.

Twenty targets cannot determine 36 parameters, and Nelder-Mead slows down with dimension. Therefore the search proceeds
block by block (subspace searches as in Subplex, Rowan 1990), each block containing the parameters on which one group of
targets depends; a weak regularisation keeps parameters on which no target depends at their published values.

The search uses coarse time steps. Before each round every start is also run with the final steps, and the difference of
the measures is added to the coarse ones for that round (defect correction), so that the final loop is the one tuned.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve_triangular

from coronaryuq.calibration import parameters
from coronaryuq.calibration.least_squares_start import approach
from coronaryuq.calibration.loop import Loop
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.simplex import nelder_mead
from coronaryuq.calibration.targets import BY_NAME, counted, measurement_covariance, misfits
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.core import seeds

FAILED = 1e9
"""Cost of a loop that has no periodic state."""

LIMIT, STEEPER = 2.0, 30.0
"""Factor on the cost of a clinical target's misfit beyond two tolerances (4 %): all of them should end within 5 %,
which matters more than a close fit of the others when targets contradict each other."""

UNDEFINED = 1e3
"""Misfit of a measure that does not exist, such as the timing of a valve that stays closed."""

EFFORT = {"filling": 0.5, "right": 0.3}
"""Fraction of the evaluations per parameter for blocks on which few targets depend."""

FIRST_STEP = 0.1
"""Size of a search's first simplex, as a fraction of the box; halved in each later round."""

Report = Callable[[str], None]


@dataclass(frozen=True)
class Start:
    """One start of the search: its point (36,), cost, periodic state, and final minus coarse measures (defect)."""

    point: np.ndarray
    cost: float
    state: np.ndarray
    defect: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Objective:
    """What a search minimises: a sum of squared residuals.

    Without errors, as in the paper, these are misfits over tolerances, with excess of clinical ones, and `pull` times
    the way of a parameter from its initial value over its range. With the errors of the measurements the sum is, but
    for a constant, -2 log of the posterior density of the heart: the closest fit is not the most probable heart
    where measured values contradict each other.
    """

    targets: Mapping[str, float]
    pull: float
    errors: RoutineErrors | None = None

    def residuals(self, measures: Mapping[str, np.ndarray], points: np.ndarray) -> np.ndarray:
        """Return residuals (n, m) of measures (n,) at points (n, 36)."""
        if self.errors is not None:
            return self._over_errors(measures, points, self.errors)
        moved = (points - parameters.INITIAL) / (parameters.UPPER - parameters.LOWER)
        columns = list((np.sqrt(self.pull) * moved).T)
        for name, misfit in self._misfits(measures).items():
            columns.append(misfit)
            if BY_NAME[name].clinical:
                columns.append(np.sqrt(STEEPER) * np.sign(misfit) * np.maximum(np.abs(misfit) - LIMIT, 0.0))
        return np.stack(columns, axis=1)

    def cost(self, measures: Mapping[str, np.ndarray], points: np.ndarray) -> np.ndarray:
        """Return the cost (n,) that a search minimises."""
        return np.square(self.residuals(measures, points)).sum(axis=1)

    def smooth(self) -> "Objective":
        """Return the objective without counted scores."""
        return replace(self, targets={name: value for name, value in self.targets.items() if not counted(name)})

    def _misfits(self, measures: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: np.nan_to_num(misfit, nan=UNDEFINED) for name, misfit in misfits(measures, self.targets).items()}

    def _over_errors(self, measures: Mapping[str, np.ndarray], points: np.ndarray, errors: RoutineErrors) -> np.ndarray:
        scaled = self._misfits(measures)
        scores = [misfit for name, misfit in scaled.items() if counted(name)]
        names = [name for name in scaled if not counted(name)]
        noise = measurement_covariance(self.targets, names, errors)
        tolerance = np.array([BY_NAME[name].size(self.targets[name]) for name in names])
        missed = np.stack([scaled[name] for name in names], axis=1) * tolerance
        whitened = solve_triangular(np.linalg.cholesky(noise), missed.T, lower=True).T
        moved = (points - parameters.INITIAL) / parameters.PRIOR_SD
        return np.hstack([moved, whitened, *(score[:, None] for score in scores)])


class Search:
    """Tunes one loop to one set of targets."""

    def __init__(self, loop: Loop, objective: Objective, settings: Settings, report: Report = lambda line: None):
        self.loop, self.objective, self.settings, self.report = loop, objective, settings, report

    def descend_from(self, starts: list[Start], frozen: tuple[str, ...] = ()) -> Start:
        """Return the best point reached from the candidates; `frozen` parameters are not changed."""
        kept = np.array([place for place, name in enumerate(parameters.NAMES) if name not in frozen])
        for turn in range(self.settings.rounds):
            starts = self.corrected(starts)
            if self.settings.least_squares_steps:
                starts = [self.approached(start, kept) for start in starts]
                self.report(f"round {turn + 1}, least squares: cost {_least(starts):.4g}")
            for block in parameters.BLOCKS:
                columns = np.intersect1d(parameters.columns(block), kept)
                effort = max(2, round(EFFORT.get(block, 1.0) * self.settings.evaluations_per_parameter))
                starts = self.descend(starts, columns, effort, FIRST_STEP / 2**turn)
                self.report(f"round {turn + 1}, {block}: cost {_least(starts):.4g}")
        if self.settings.final_nelder_mead:
            starts = self.corrected(starts)
            first_step = FIRST_STEP / 2 ** (self.settings.rounds + 1)
            starts = self.descend(starts, kept, self.settings.final_nelder_mead, first_step)
            self.report(f"all together: cost {_least(starts):.4g}")
        starts = self.corrected(starts)
        return min(starts, key=lambda start: start.cost)

    def candidates(self, seed: int) -> list[Start]:
        """Return the best `starts` of the initial values and random parameter sets about them."""
        random = seeds.generator(seed, "calibration", "candidates")
        width = self.settings.sampling_width * (parameters.UPPER - parameters.LOWER)
        shifts = random.uniform(-0.5, 0.5, (self.settings.candidates, len(parameters.NAMES)))
        points = np.clip(parameters.INITIAL + width * shifts, parameters.LOWER, parameters.UPPER)
        points[0] = parameters.INITIAL
        evaluation = self.loop.evaluate(points, cycles=self.settings.first_cycles)
        costs = self._costs(evaluation.measures, evaluation.ok, points)
        order = np.argsort(costs, kind="stable")[: self.settings.starts]
        self.report(
            f"{int(evaluation.ok.sum())} of {len(points)} candidates converged; lowest cost {costs[order[0]]:.4g}"
        )
        return [Start(points[i], float(costs[i]), evaluation.state[i]) for i in order]

    def settled(self, start: Start, block: str, frozen: tuple[str, ...]) -> Start:
        """Return a start with the block's parameters retuned, after others were changed."""
        kept = [place for place, name in enumerate(parameters.NAMES) if name not in frozen]
        columns = np.intersect1d(parameters.columns(block), kept)
        (start,) = self.corrected([start])
        if self.settings.least_squares_steps:
            start = self.approached(start, columns)
        (start,) = self.descend([start], columns, self.settings.evaluations_per_parameter, FIRST_STEP)
        self.report(f"{block} again: cost {start.cost:.4g}")
        return start

    def approached(self, start: Start, columns: np.ndarray) -> Start:
        """Return a start after a few least-squares steps over the parameters at `columns`, without counted scores."""
        smooth = self.objective.smooth()

        def values_of(values: np.ndarray) -> np.ndarray:
            points = np.tile(start.point, (len(values), 1))
            points[:, columns] = values
            states = np.tile(start.state, (len(points), 1))
            evaluation = self.loop.evaluate(points, states, self.settings.least_squares_cycles)
            measures = {name: value + start.defect.get(name, 0.0) for name, value in evaluation.measures.items()}
            found = smooth.residuals(measures, points)
            return np.where(evaluation.ok[:, None], found, UNDEFINED)

        point = start.point.copy()
        point[columns] = approach(
            values_of,
            point[columns],
            parameters.LOWER[columns],
            parameters.UPPER[columns],
            self.settings.least_squares_steps,
        )
        evaluation = self.loop.evaluate(point[None], start.state[None], self.settings.first_cycles)
        measures = {name: value + start.defect.get(name, 0.0) for name, value in evaluation.measures.items()}
        reached = float(self._costs(measures, evaluation.ok, point[None])[0])
        return replace(start, point=point, cost=reached, state=evaluation.state[0]) if reached < start.cost else start

    def corrected(self, starts: list[Start]) -> list[Start]:
        """Return the same points with their cost at the final time steps, and their defect."""
        points, states = np.array([start.point for start in starts]), np.array([start.state for start in starts])
        coarse = self.loop.evaluate(points, states, self.settings.first_cycles)
        fine = self.loop.evaluate(
            points, coarse.state, self.settings.first_cycles, steps_per_cycle=self.settings.final_steps_per_cycle
        )
        costs = self._costs(fine.measures, coarse.ok & fine.ok, points)
        defects = {name: fine.measures[name] - coarse.measures[name] for name in fine.measures}
        return [
            replace(
                start,
                cost=float(costs[row]),
                state=coarse.state[row],
                defect={name: float(np.nan_to_num(defect[row])) for name, defect in defects.items()},
            )
            for row, start in enumerate(starts)
        ]

    def descend(self, starts: list[Start], columns: np.ndarray, per_parameter: int, first_step: float) -> list[Start]:
        """Run Nelder-Mead over the parameters at `columns` from every start."""
        best = list(starts)

        def objective(values: np.ndarray, which: np.ndarray) -> np.ndarray:
            points = np.array([starts[k].point for k in which])
            points[:, columns] = values
            states = np.array([best[k].state for k in which])
            evaluation = self.loop.evaluate(points, states, self.settings.cycles)
            measures = {
                name: value + [starts[k].defect.get(name, 0.0) for k in which]
                for name, value in evaluation.measures.items()
            }
            costs = self._costs(measures, evaluation.ok, points)
            for row, k in enumerate(which):
                if costs[row] < best[k].cost:
                    best[k] = replace(best[k], point=points[row], cost=float(costs[row]), state=evaluation.state[row])
            return costs

        nelder_mead(
            objective,
            [start.point[columns] for start in starts],
            parameters.LOWER[columns],
            parameters.UPPER[columns],
            first_step,
            per_parameter * len(columns),
            tolerance=1e-3,
        )
        return best

    def _costs(self, measures: Mapping[str, np.ndarray], ok: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.where(ok, self.objective.cost(measures, points), FAILED)


def _least(starts: list[Start]) -> float:
    return min(start.cost for start in starts)
