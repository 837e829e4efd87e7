"""Target flows without the errors of the perfusion map that a search named.

The search names them in readings of perfusion, the posterior is fitted to target flows. If the case says under which
condition the readings are those of its map, what they lose by the error the targets lose too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.adoption.choice import Placed
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.perfusion.targets import PerfusionTargets
from coronaryuq.zerod.effect_mixture import Member
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.effects.perfusion import MapError

STEPS, CONVERGED, STEP = 50, 1e-9, 1e-6
"""Newton steps at most, relative residual that ends them, relative step of the finite differences."""
OF_MAP = "an error of the perfusion map: the target flows are corrected, not the model"
NOT_STATED = (
    "an error of perfusion readings: they are corrected, not the model; the target flows are not, because the case "
    "does not say that the readings are of its map (measurements.map_condition)"
)
BEYOND = "an error of the perfusion map with which no flow would be read as measured; the target flows stay"


@dataclass(frozen=True)
class Corrected:
    """Target flows without errors of the map, and what became of each of these errors, by its label."""

    targets: PerfusionTargets
    became: dict[str, str]

    @property
    def changed(self) -> bool:
        """Whether any error was undone."""
        return OF_MAP in self.became.values()


@dataclass(frozen=True)
class Readings:
    """Mean perfusion (k,), mL/s/g, of `series`, and which of them (N,) are those of the map, in the targets' order."""

    series: Sequence[Series]
    value: np.ndarray
    of_map: np.ndarray


def readings_of_map(
    measured: Sequence[Measured], condition: str, beds: Sequence[str], file: str | Path = "measurements"
) -> Readings:
    """Return the mean perfusion among some measurements.

    Raises
    ------
    InputError
        If that of a bed under the condition is missing.
    """
    series = [one for one in measured if one.quantity == "perfusion" and one.statistic == "mean"]
    index = {(one.condition, one.location): number for number, one in enumerate(series)}
    for bed in beds:
        if (condition, bed) not in index:
            remedy = f"the table has no mean perfusion of {bed} under it; give that of every bed with a target flow"
            raise InputError(file, "measurements.map_condition", condition, remedy)
    of_map = np.array([index[condition, bed] for bed in beds])
    return Readings(series, np.array([float(one.value[0]) for one in series]), of_map)


def without_map_errors(
    targets: PerfusionTargets, classes: Sequence[Sequence[Placed]], readings: Readings | None
) -> Corrected:
    """Return the target flows without the errors of the map among the members of classes.

    Mean and covariance are those over the members, by their probabilities: under an error the targets are those whose
    readings it would have turned into the ones measured, with the noise as that inversion carries it, and with the
    uncertainty of the error's size. Errors of different classes are undone one after the other.

    Parameters
    ----------
    targets
        Target flows as the map gives them.
    classes
        What a search named.
    readings
        None if no readings are those of the map; the targets then stay.
    """
    became: dict[str, str] = {}
    for members in classes:
        errors = [one for one in members if isinstance(effect(one.effect), MapError)]
        undone = []
        for one in errors:
            found = None if readings is None else _undone(one, readings)
            became[one.label] = NOT_STATED if readings is None else BEYOND if found is None else OF_MAP
            if found is not None:
                undone.append((one.probability, found))
        if readings is not None and undone:
            readings, targets = _mixed(readings, targets, undone)
    return Corrected(targets, became)


@dataclass(frozen=True)
class _Undone:
    """Perfusion (k,) without an error, its derivatives (k, k) by the readings, and by the sizes (k, m), of sd one."""

    flow: np.ndarray
    slope: np.ndarray
    by_size: np.ndarray


def _mixed(
    readings: Readings, targets: PerfusionTargets, undone: Sequence[tuple[float, _Undone]]
) -> tuple[Readings, PerfusionTargets]:
    y, at, mean = readings.value, readings.of_map, targets.mean
    noise = targets.covariance / np.outer(mean, mean)
    rest = 1.0 - sum(probability for probability, _ in undone)
    flow, square = rest * y, rest * (noise + 1.0)
    for probability, one in undone:
        factor, slope = one.flow[at] / y[at], one.slope[np.ix_(at, at)] * y[at] / y[at][:, None]
        size = one.by_size[at] / y[at][:, None]
        flow = flow + probability * one.flow
        square = square + probability * (slope @ noise @ slope.T + size @ size.T + np.outer(factor, factor))
    factor = flow[at] / y[at]
    covariance = (square - np.outer(factor, factor)) * np.outer(mean, mean)
    # The tissue that a target supplies is volume x mean / baseline, which no error of the map changes.
    changed = {"mean": mean * factor, "baseline": targets.baseline * factor, "covariance": covariance}
    changed["relative_sd"] = np.sqrt(np.diag(covariance)) / changed["mean"]
    return Readings(readings.series, flow, at), targets.model_copy(update=changed)


def _undone(one: Placed, readings: Readings) -> _Undone | None:
    """Return the perfusion without the error, None if no positive perfusion is read as the readings are."""
    sizes = np.eye(len(one.mean) + 1)[1:]
    solved = [_solved(one, readings, z) for z in (np.zeros(len(one.mean)), *sizes[:, 1:], *-sizes[:, 1:])]
    if any(found is None for found in solved):
        return None
    (flow, slope), *others = [found for found in solved if found is not None]
    half = len(others) // 2
    by_size = [0.5 * (up[0] - down[0]) for up, down in zip(others[:half], others[half:], strict=True)]
    return _Undone(flow, np.linalg.inv(slope), np.array(by_size).T)


def _solved(one: Placed, readings: Readings, z: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the perfusion (k,) that is read as measured with sizes at z (m,), and the readings' derivatives there."""
    y, flow = readings.value, readings.value
    for _ in range(STEPS):
        rows = np.vstack([flow, flow + np.diag(STEP * flow)])
        read = _read(one, readings.series, z, rows)
        slope = ((read[1:] - read[0]) / (STEP * flow)[:, None]).T
        if np.max(np.abs(read[0] / y - 1.0)) < CONVERGED:
            return flow, slope
        try:
            flow = flow - np.linalg.solve(slope, read[0] - y)
        except np.linalg.LinAlgError:
            return None
        if not (np.isfinite(flow).all() and (flow > 0.0).all()):
            return None
    return None


def _read(one: Placed, series: Sequence[Series], z: np.ndarray, flows: np.ndarray) -> np.ndarray:
    """Return the readings (n, k) of perfusion (n, k) with the error of sizes at z (m,)."""
    member = Member(one.effect, one.place, 1.0, True, tuple(one.mean), tuple(map(tuple, one.covariance)), {})
    sizes = member.sizes(np.tile(z, (len(flows), 1)))
    return np.hstack(member.law.observe(one.place, sizes, series, [column[:, None] for column in flows.T]))
