"""Hyperaemic flow: the venous fraction of coronary resistance that meets the resting split and hyperaemic total."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.calibration import parameters
from coronaryuq.calibration.loop import Loop
from coronaryuq.case.network.network import Network
from coronaryuq.zerod.network.beds import beds

ARTERIAL, VENOUS = parameters.NAMES.index("R_cor"), parameters.NAMES.index("Rv_cor")
STEP = 0.05
"""Of the logarithm of a factor, for finite differences."""
ROUNDS = 4


@dataclass(frozen=True)
class HyperaemicTarget:
    """The measured hyperaemia: mean flow (mL/s) of the named beds together, with Ra and Ram times `scale`."""

    flow: float
    beds: tuple[str, ...]
    scale: float


def hyperaemic_changes(network: Network, points: np.ndarray, scale: float) -> dict[str, np.ndarray]:
    """Return the parameters' changes with Ra and Ram of every coronary bed times `scale`."""
    changed = parameters.changes(points, network)
    for name, bed in beds(network).items():
        for member in (bed.arterial, *bed.myocardial):
            changed[f"{name}.{member}"] = changed[f"{name}.{member}"] * scale
    return changed


def hyperaemic_flow(
    loop: Loop, points: np.ndarray, start: np.ndarray, target: HyperaemicTarget, cycles: int | None
) -> np.ndarray:
    """Return the mean flow (n,) in mL/s of the target's beds together, at points (n, 36), from states (n, columns)."""
    extra = hyperaemic_changes(loop.network, points, target.scale)
    names = loop.bed_flows(target.beds)
    evaluation = loop.evaluate(points, start, cycles, extra=extra, waveforms=names)
    total = sum(evaluation.waves[name] for name in names)
    return np.trapezoid(total, evaluation.time, axis=1) / (evaluation.time[-1] - evaluation.time[0])


def meet_hyperaemic_flow(
    loop: Loop, point: np.ndarray, state: np.ndarray, split: float | None, target: HyperaemicTarget, cycles: int
) -> np.ndarray:
    """Return the point with R_cor and Rv_cor such that split (%) and hyperaemic flow are met, if their ranges allow.

    Newton's method on the logarithms, derivatives by differences: one batch at rest and one under hyperaemia per round.
    Without a split target the split of `point` is kept.
    """
    point = point.copy()
    moved = (ARTERIAL, VENOUS)
    for _ in range(ROUNDS):
        points = np.tile(point, (3, 1))
        points[1, ARTERIAL] += STEP
        points[2, VENOUS] += STEP
        states = np.tile(state, (3, 1))
        rest = loop.evaluate(points, states, cycles)
        values = np.log([rest.measures["AorCorSplit"], hyperaemic_flow(loop, points, rest.state, target, cycles)])
        if split is None:
            split = float(rest.measures["AorCorSplit"][0])
        missing = np.log([split, target.flow]) - values[:, 0]
        slopes = (values[:, 1:] - values[:, :1]) / STEP
        step = np.linalg.solve(slopes, missing)
        for place, change in zip(moved, step, strict=True):
            moved_to = point[place] + np.clip(change, -1.0, 1.0)
            point[place] = np.clip(moved_to, parameters.LOWER[place], parameters.UPPER[place])
        if point[VENOUS] in (parameters.LOWER[VENOUS], parameters.UPPER[VENOUS]):
            # At the bound the target cannot be met; the resting split still can.
            left = missing[0] - slopes[0, 1] * (point[VENOUS] - points[0, VENOUS])
            point[ARTERIAL] = points[0, ARTERIAL] + np.clip(left / slopes[0, 0], -1.0, 1.0)
        state = rest.state[0]
    return point
