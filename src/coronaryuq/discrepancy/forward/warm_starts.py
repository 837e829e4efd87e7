"""Where runs of a closed loop start: at the nearest periodic state met before, holding the blood they have to hold."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.forward.network_values import carried_over
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine

MOST = 300
"""Points remembered per condition, the latest."""
NEAR = 0.2
"""Distance below which two points share one state: finite differences are not worth a memory."""
OTHER_EFFECT = 2.0
"""Distance of two points of which one has an effect that the other lacks, in prior standard deviations."""


@dataclass(frozen=True)
class Point:
    """Standard numbers of a run: nuisance parameters (p,), and sizes of each effect at its place."""

    z: np.ndarray
    sizes: dict[tuple[str, str], np.ndarray]

    @property
    def distance(self) -> float:
        """From the model as it is."""
        return float(np.sqrt(self.z @ self.z + OTHER_EFFECT**2 * len(self.sizes)))


@dataclass(frozen=True)
class Structure:
    """A network's engine, and where its locations were before elements were added: old → new names."""

    engine: Engine
    renamed: dict[str, str]


class Known:
    """The latest `MOST` points met under one condition, as arrays: thousands of distances are asked for."""

    def __init__(self, count: int):
        self.points: list[Point] = []
        self.origins: list[tuple[Structure, np.ndarray]] = []
        self._z, self._effects, self._engines = np.zeros((MOST, count)), np.zeros(MOST), np.zeros(MOST, dtype=object)
        self._sizes: dict[tuple[str, str], np.ndarray] = {}
        """Of every effect met, (MOST, sizes), NaN where a point lacks it."""
        self._kept = 0

    def branched(self) -> "Known":
        """A copy that goes on by itself."""
        other = copy.copy(self)
        other.points, other.origins = self.points.copy(), self.origins.copy()
        other._z, other._effects, other._engines = self._z.copy(), self._effects.copy(), self._engines.copy()
        other._sizes = {key: sizes.copy() for key, sizes in self._sizes.items()}
        return other

    def distances(self, point: Point) -> np.ndarray:
        """From every point known, (n,)."""
        count = len(self.points)
        squares = np.sum((self._z[:count] - point.z) ** 2, axis=1)
        unlike = self._effects[:count] + len(point.sizes)
        for key, sizes in point.sizes.items():
            if key in self._sizes:
                apart = np.sum((self._sizes[key][:count] - sizes) ** 2, axis=1)
                both = np.isfinite(apart)
                squares[both] += apart[both]
                unlike[both] -= 2
        return np.sqrt(squares + OTHER_EFFECT**2 * unlike)

    def has(self, point: Point, engine: Engine) -> bool:
        """Whether a near point of the same network is known."""
        return bool(np.any((self.distances(point) < NEAR) & (self._engines[: len(self.points)] == engine)))

    def add(self, point: Point, structure: Structure, state: np.ndarray) -> None:
        """In the place of the oldest, where there are `MOST`."""
        seat, self._kept = self._kept % MOST, self._kept + 1
        if len(self.points) < MOST:
            self.points.append(point)
            self.origins.append((structure, state))
        for key in self.points[seat].sizes.keys() & self._sizes.keys():
            self._sizes[key][seat] = np.nan
        self.points[seat], self.origins[seat] = point, (structure, state)
        self._z[seat], self._effects[seat], self._engines[seat] = point.z, len(point.sizes), structure.engine
        for key, sizes in point.sizes.items():
            self._sizes.setdefault(key, np.full((MOST, len(sizes)), np.nan))[seat] = sizes


class Starts:
    """Periodic states (unknowns,) that runs have found, by condition.

    A closed loop keeps the blood that it starts with, and what a sample has to hold is what its parameters make of the
    state that the model as it is has under the condition. A state from elsewhere is filled up to that, or bled.
    """

    def __init__(self):
        self._known: dict[str, Known] = {}

    def branched(self) -> "Starts":
        """A copy that goes on by itself."""
        other = Starts()
        other._known = {condition: known.branched() for condition, known in self._known.items()}
        return other

    def keep(self, condition: str, point: Point, structure: Structure, state: np.ndarray) -> None:
        """Remember the state of a run, unless that of a near point of the same network is known."""
        known = self._known.setdefault(condition, Known(len(point.z)))
        if not known.has(point, structure.engine):
            known.add(point, structure, state)

    def near(
        self, conditions: Sequence[str], points: Sequence[Point], structure: Structure, own: np.ndarray, changes: dict
    ) -> np.ndarray:
        """Starts (n, unknowns) of runs at `points`. own: (n, unknowns), starts by the model as it is; changes: the
        runs' parameters, as the engine takes them.
        """
        found, carried = own.copy(), {}
        origin: dict[int, int | None] = {}
        for number, (condition, point) in enumerate(zip(conditions, points, strict=True)):
            known = self._known.get(condition)
            if known is None:
                continue
            distances = known.distances(point)
            best = int(np.argmin(distances))
            if distances[best] >= point.distance:
                continue
            key = condition, best
            if key not in carried:
                source, state = known.origins[best]
                carried[key] = state if source.engine is structure.engine else _moved(source, structure, state)
            found[number] = carried[key]
            origin[number] = best
        if origin:
            volume = BloodVolume(structure.engine.model)
            numbers = np.array(list(origin))
            mine = {name: value[numbers] for name, value in changes.items() if np.ndim(value) == 1}
            missing = volume.of(own[numbers], mine) - volume.of(found[numbers], mine)
            found[numbers] = volume.filled(found[numbers], missing)
        return found


def _moved(source: Structure, wanted: Structure, state: np.ndarray) -> np.ndarray:
    """A state of one network for another that differs in added elements."""
    places = source.renamed.keys() | wanted.renamed.keys()
    both = {source.renamed.get(place, place): wanted.renamed.get(place, place) for place in places}
    renamed = {old: new for old, new in both.items() if old != new}
    return carried_over(source.engine.state_names, state, wanted.engine.state_names, renamed)
