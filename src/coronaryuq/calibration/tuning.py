"""Stage one as a whole: initial scaling, search, flow reserve, and the tuned loop at rest and under hyperaemia."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from coronaryuq.calibration import conductance_shares, parameters
from coronaryuq.calibration.coronary_flow_reserve import Reserve, hyperaemic_changes, hyperaemic_flow, meet_reserve
from coronaryuq.calibration.initial_scaling import scaled
from coronaryuq.calibration.loop import Evaluation, Loop
from coronaryuq.calibration.search import Report, Search
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.targets import TARGETS, misfits
from coronaryuq.core.units import ML_PER_MIN
from coronaryuq.zerod.network.changes import with_changes

RESERVE_TOLERANCE = 0.05
"""Relative; of the hyperaemic total, for its misfit in fit.csv."""


@dataclass(frozen=True)
class Tuned:
    """The tuned loop in CGS, each network with its periodic state as initial condition; tables as they are written."""

    rest: dict
    hyperaemia: dict
    parameters: pd.DataFrame
    fit: pd.DataFrame
    evaluation: Evaluation


def tune_loop(
    network: Mapping,
    targets: Mapping[str, float],
    settings: Settings,
    seed: int,
    hyperaemia: float,
    shares: Mapping[str, float] | None = None,
    reserve: Reserve | None = None,
    threads: int = 1,
    report: Report = lambda line: None,
) -> Tuned:
    """Tune a CGS network to targets in their own units (`calibration.targets`).

    shares: share of coronary conductance of every bed (see `calibration.beds`); without it the network's own stay.
    reserve: hyperaemic flow to be met by the venous share; without it the waveforms decide. Results depend on the seed,
    not on `threads`. Raises InputError where a target that tuning cannot do without is missing.
    """
    period = network["closed_loop_blocks"][0]["cardiac_cycle_period"]
    network = scaled(network, targets, period)
    if shares is not None:
        conductance_shares.share_out(network, shares)
    loop = Loop(network, settings.steps_per_cycle, threads)
    search = Search(loop, targets, settings, report)
    split = targets.get("AorCorSplit")
    found = search.candidates(seed)
    if reserve is None:
        best = search.descend_from(found)
    else:
        found = [
            replace(one, point=meet_reserve(loop, one.point, one.state, split, reserve, settings.cycles))
            for one in found
        ]
        best = search.descend_from(found, frozen=("Rv_cor",))
        # The last totals shift the phase of coronary flow; the other coronary parameters bring it back.
        best = replace(best, point=meet_reserve(loop, best.point, best.state, split, reserve, settings.cycles))
        best = search.settled(best, "coronary", frozen=("R_cor", "Rv_cor"))
    report(f"{loop.evaluations} loop runs")
    return _tuned(loop, best.point, best.state, targets, settings, hyperaemia, reserve)


def _tuned(loop, point, state, targets, settings, hyperaemia, reserve) -> Tuned:
    """Both conditions at the final resolution, as networks and tables."""
    fine = Loop(loop.network, settings.final_steps_per_cycle, loop.threads)
    points = point[None]
    rest = fine.evaluate(points, state[None], tolerance=settings.periodicity)
    if not rest.ok.all():
        raise RuntimeError(f"the tuned loop has no periodic state at rest: {rest.status[0]}")
    once_more = fine.evaluate(points, rest.state, cycles=1)
    relaxed = hyperaemic_changes(fine.network, points, hyperaemia)
    stress = fine.evaluate(points, rest.state, tolerance=settings.periodicity, extra=relaxed)
    if not stress.ok.all():
        raise RuntimeError(f"the tuned loop has no periodic state under hyperaemia: {stress.status[0]}")
    simulated = {name: float(value[0]) for name, value in rest.measures.items()}
    for name in ("PaoMin", "PaoMax", "PaoMean", "AbsQin"):
        simulated[f"{name}_conv"] = abs(float(once_more.measures[name][0]) - simulated[name])
    fit = fit_table(simulated, targets)
    if reserve is not None:
        flow = float(hyperaemic_flow(fine, points, stress.state, reserve, 1)[0])
        fit = pd.concat([fit, _reserve_row(flow, reserve)], ignore_index=True)
    return Tuned(
        _network(fine, parameters.changes(points, fine.network), rest),
        _network(fine, relaxed, stress),
        parameter_table(point),
        fit,
        rest,
    )


def _network(loop: Loop, changed: Mapping[str, np.ndarray], evaluation: Evaluation) -> dict:
    network = with_changes(loop.network, {name: float(np.ravel(value)[0]) for name, value in changed.items()})
    network["initial_condition"] = {
        name: float(value) for name, value in zip(loop.engine.unknowns, evaluation.state[0], strict=False)
    }
    return network


def fit_table(simulated: Mapping[str, float], targets: Mapping[str, float]) -> pd.DataFrame:
    """A row per given target: target, description, unit, measured, simulated, misfit, relative, tuned, clinical."""
    off = misfits({name: np.array([value]) for name, value in simulated.items()}, targets)
    rows = []
    for target in TARGETS:
        if target.name not in targets:
            continue
        measured, value = targets[target.name], simulated[target.name]
        tolerance = target.tolerance * (abs(measured) if target.relative else 1.0)
        rows.append(
            {
                "target": target.name,
                "description": target.description,
                "unit": target.unit,
                "measured": measured,
                "simulated": value,
                "misfit": (value - measured) / tolerance,
                "relative": value / measured - 1.0 if measured else float("nan"),
                "tuned": target.name in off,
                "clinical": target.clinical,
            }
        )
    return pd.DataFrame(rows)


def _reserve_row(flow: float, reserve: Reserve) -> pd.DataFrame:
    relative = flow / reserve.flow - 1.0
    return pd.DataFrame(
        [
            {
                "target": "QLVHyper",
                "description": "Hyperaemic flow of the LV-perfusing outlets",
                "unit": "mL/min",
                "measured": reserve.flow / ML_PER_MIN,
                "simulated": flow / ML_PER_MIN,
                "misfit": relative / RESERVE_TOLERANCE,
                "relative": relative,
                "tuned": True,
                "clinical": True,
            }
        ]
    )


def parameter_table(point: np.ndarray) -> pd.DataFrame:
    """A row per parameter: name, description, unit, value, initial, lower, upper, block."""
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
