"""Calibration as a whole: initial scaling, search, hyperaemic flow, and the tuned loop at rest and under hyperaemia."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from coronaryuq.calibration import conductance_shares, parameters
from coronaryuq.calibration.heart_posterior import assumed_parameters, heart_parameters, heart_posterior
from coronaryuq.calibration.hyperaemic_flow import (
    HyperaemicTarget,
    hyperaemic_changes,
    hyperaemic_flow,
    meet_hyperaemic_flow,
)
from coronaryuq.calibration.initial_scaling import scaled
from coronaryuq.calibration.loop import Evaluation, Loop
from coronaryuq.calibration.search import Objective, Report, Search, Start
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.targets import TARGETS, misfits
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.network.network import UNCERTAIN, Network
from coronaryuq.core.units import ML_PER_MIN
from coronaryuq.zerod.network.changes import with_changes

RESERVE_TOLERANCE = 0.05
"""Relative tolerance of the hyperaemic total, for its misfit in fit.csv."""


@dataclass(frozen=True)
class Tuned:
    """The tuned loop in CGS, each network with its periodic state as initial condition, and the tables to write."""

    rest: Network
    hyperaemia: Network
    parameters: pd.DataFrame
    fit: pd.DataFrame
    evaluation: Evaluation


@dataclass(frozen=True)
class Goal:
    """Targets and conditions to which a loop is tuned.

    targets: in their own units (`calibration.targets`). hyperaemia: factor on Ra and Ram of every coronary bed. shares:
    fraction of coronary conductance of every bed (`conductance_shares`); None keeps the network's own. hyperaemic:
    hyperaemic flow to be met by the venous fraction of resistance; without it the waveforms determine that fraction.
    errors: of the measurements, if the heart is uncertain.
    """

    targets: Mapping[str, float]
    hyperaemia: float
    shares: Mapping[str, float] | None = None
    hyperaemic: HyperaemicTarget | None = None
    errors: RoutineErrors | None = None


def tune_loop(
    network: Network, goal: Goal, settings: Settings, seed: int, threads: int = 1, report: Report = lambda line: None
) -> Tuned:
    """Tune a CGS network. Results depend on the seed, not on `threads`; `report` gets lines of progress."""
    targets, hyperaemic = goal.targets, goal.hyperaemic
    period = network.heart["cardiac_cycle_period"]
    network = scaled(network, targets, period)
    if goal.shares is not None:
        conductance_shares.share_out(network, goal.shares)
    loop = Loop(network, settings.steps_per_cycle, threads)
    search = Search(loop, Objective(targets, settings.regularisation, goal.errors), settings, report)
    split = targets.get("AorCorSplit")
    starts = search.candidates(seed)
    if hyperaemic is None:
        best = search.descend_from(starts)
    else:

        def with_reserve(start: Start) -> Start:
            return replace(
                start, point=meet_hyperaemic_flow(loop, start.point, start.state, split, hyperaemic, settings.cycles)
            )

        best = search.descend_from([with_reserve(start) for start in starts], frozen=("Rv_cor",))
        # The last totals shift the phase of coronary flow; the other coronary parameters restore it.
        best = search.settled(with_reserve(best), "coronary", frozen=("R_cor", "Rv_cor"))
    report(f"{loop.evaluations} loop runs")
    return _tuned(loop, best, goal, settings)


def _tuned(loop: Loop, best: Start, goal: Goal, settings: Settings) -> Tuned:
    """Both conditions at the final resolution, as networks and tables."""
    targets, hyperaemic = goal.targets, goal.hyperaemic
    fine = Loop(loop.network, settings.final_steps_per_cycle, loop.threads)
    point, state = best.point, best.state
    points = point[None]
    rest = fine.evaluate(points, state[None], tolerance=settings.periodicity)
    if not rest.ok.all():
        raise RuntimeError(f"the tuned loop has no periodic state at rest: {rest.status[0]}")
    next_cycle = fine.evaluate(points, rest.state, cycles=1)
    relaxed = hyperaemic_changes(fine.network, points, goal.hyperaemia)
    stress = fine.evaluate(points, rest.state, tolerance=settings.periodicity, extra=relaxed)
    if not stress.ok.all():
        raise RuntimeError(f"the tuned loop has no periodic state under hyperaemia: {stress.status[0]}")
    simulated = {name: float(value[0]) for name, value in rest.measures.items()}
    for name in ("PaoMin", "PaoMax", "PaoMean", "AbsQin"):
        simulated[f"{name}_conv"] = abs(float(next_cycle.measures[name][0]) - simulated[name])
    fit = fit_table(simulated, targets)
    if hyperaemic is not None:
        flow = float(hyperaemic_flow(fine, points, stress.state, hyperaemic, 1)[0])
        fit = pd.concat([fit, _hyperaemic_row(flow, hyperaemic)], ignore_index=True)
    stressed = _network(fine, relaxed, stress)
    if goal.errors is not None:
        states = rest.state[0], stress.state[0]
        most = settings.final_steps_per_cycle
        found = heart_posterior(loop, point, states, targets, goal.hyperaemia, goal.errors, most)
        known = stressed.get(UNCERTAIN, [])
        stressed[UNCERTAIN] = [*known, *heart_parameters(found, loop), *assumed_parameters(stressed, goal.errors)]
    return Tuned(
        _network(fine, parameters.changes(points, fine.network), rest),
        stressed,
        parameter_table(point),
        fit,
        rest,
    )


def _network(loop: Loop, changed: Mapping[str, np.ndarray], evaluation: Evaluation) -> Network:
    network = with_changes(loop.network, {name: float(np.ravel(value)[0]) for name, value in changed.items()})
    network["initial_condition"] = {
        name: float(value) for name, value in zip(loop.engine.unknowns, evaluation.state[0], strict=False)
    }
    return network


def fit_table(simulated: Mapping[str, float], targets: Mapping[str, float]) -> pd.DataFrame:
    """Return a row per target: target, description, unit, measured, simulated, misfit, relative, tuned, clinical."""
    missed = misfits({name: np.array([value]) for name, value in simulated.items()}, targets)
    rows = []
    for target in TARGETS:
        if target.name not in targets:
            continue
        measured, value = targets[target.name], simulated[target.name]
        tolerance = target.size(measured)
        rows.append(
            {
                "target": target.name,
                "description": target.description,
                "unit": target.unit,
                "measured": measured,
                "simulated": value,
                "misfit": (value - measured) / tolerance,
                "relative": value / measured - 1.0 if measured else float("nan"),
                "tuned": target.name in missed,
                "clinical": target.clinical,
            }
        )
    return pd.DataFrame(rows)


def _hyperaemic_row(flow: float, hyperaemic: HyperaemicTarget) -> pd.DataFrame:
    relative = flow / hyperaemic.flow - 1.0
    return pd.DataFrame(
        [
            {
                "target": "QLVHyper",
                "description": "Hyperaemic flow of the LV-perfusing outlets",
                "unit": "mL/min",
                "measured": hyperaemic.flow / ML_PER_MIN,
                "simulated": flow / ML_PER_MIN,
                "misfit": relative / RESERVE_TOLERANCE,
                "relative": relative,
                "tuned": True,
                "clinical": True,
            }
        ]
    )


def parameter_table(point: np.ndarray) -> pd.DataFrame:
    """Return a row per parameter: name, description, unit, value, initial, lower, upper, block."""
    rows = [
        {
            "name": parameter.name,
            "description": parameter.description,
            "unit": parameter.unit,
            "value": value,
            "initial": parameter.initial,
            "lower": parameter.lower,
            "upper": parameter.upper,
            "block": parameter.block,
        }
        for parameter, value in zip(parameters.PARAMETERS, parameters.values(point)[0], strict=True)
    ]
    return pd.DataFrame(rows)
