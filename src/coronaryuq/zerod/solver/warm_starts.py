"""Initial states of closed-loop runs: the nearest known periodic state, adjusted to the required blood volume."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.carry_over import carry_over
from coronaryuq.zerod.solver.engine import Engine

MOST = 300
"""Number of the latest points remembered per condition."""
NEAR = 0.2
"""Distance below which two points share one state, so that finite differences are not remembered."""
OTHER_EFFECT = 2.0
"""Distance between points that differ by the presence of an effect, in prior standard deviations."""


@dataclass(frozen=True)
class Point:
    """Standard normal numbers of a run: nuisance parameters (p,), and sizes of each effect at its place."""

    z: np.ndarray
    sizes: dict[tuple[str, str], np.ndarray]

    @property
    def distance(self) -> float:
        """Distance from the unmodified model."""
        return float(np.sqrt(self.z @ self.z + OTHER_EFFECT**2 * len(self.sizes)))


@dataclass(frozen=True)
class Structure:
    """Engine of a network, and old → new names of locations since elements were added."""

    engine: Engine
    renamed: dict[str, str]


class KnownStates:
    """The latest `MOST` points under one condition, as arrays for fast distances."""

    def __init__(self, count: int):
        self.origins: list[tuple[Structure, np.ndarray]] = []
        self._z, self._effects, self._engines = np.zeros((MOST, count)), np.zeros(MOST), np.zeros(MOST, dtype=object)
        self._sizes: dict[tuple[str, str], np.ndarray] = {}
        """Sizes of every known effect, (MOST, sizes), NaN where a point lacks it."""
        self._kept = 0

    def fork(self) -> "KnownStates":
        """Return an independent copy."""
        other = copy.copy(self)
        other.origins = self.origins.copy()
        other._z, other._effects, other._engines = self._z.copy(), self._effects.copy(), self._engines.copy()
        other._sizes = {key: sizes.copy() for key, sizes in self._sizes.items()}
        return other

    def distances(self, point: Point) -> np.ndarray:
        """Return the distances (n,) to all known points."""
        count = len(self.origins)
        squares = np.sum((self._z[:count] - point.z) ** 2, axis=1)
        differing = self._effects[:count] + len(point.sizes)
        for key, sizes in point.sizes.items():
            if key in self._sizes:
                apart = np.sum((self._sizes[key][:count] - sizes) ** 2, axis=1)
                both = np.isfinite(apart)
                squares[both] += apart[both]
                differing[both] -= 2
        return np.sqrt(squares + OTHER_EFFECT**2 * differing)

    def has(self, point: Point, engine: Engine) -> bool:
        """Whether a close point of the same network is stored."""
        return bool(np.any((self.distances(point) < NEAR) & (self._engines[: len(self.origins)] == engine)))

    def add(self, point: Point, structure: Structure, state: np.ndarray) -> None:
        """Add a point, replacing the oldest if there are `MOST`."""
        seat, self._kept = self._kept % MOST, self._kept + 1
        self.origins[seat : seat + 1] = [(structure, state)]
        for known in self._sizes.values():
            known[seat] = np.nan
        self._z[seat], self._effects[seat], self._engines[seat] = point.z, len(point.sizes), structure.engine
        for key, sizes in point.sizes.items():
            self._sizes.setdefault(key, np.full((MOST, len(sizes)), np.nan))[seat] = sizes


class WarmStarts:
    """Periodic states (unknowns,) of earlier runs, by condition.

    A closed loop conserves the blood volume that it starts with; the nearest state is adjusted to that of the sample.
    """

    def __init__(self) -> None:
        self._known: dict[str, KnownStates] = {}

    def fork(self) -> "WarmStarts":
        """Return an independent copy."""
        other = WarmStarts()
        other._known = {condition: known.fork() for condition, known in self._known.items()}
        return other

    def keep(self, condition: str, point: Point, structure: Structure, state: np.ndarray) -> None:
        """Remember the state of a run, unless a close point of the same network is known."""
        known = self._known.setdefault(condition, KnownStates(len(point.z)))
        if not known.has(point, structure.engine):
            known.add(point, structure, state)

    def near(
        self, wanted: Sequence[tuple[str, Point]], structure: Structure, own: np.ndarray, changes: dict
    ) -> np.ndarray:
        """Return the initial states (n, unknowns) of runs at points, each under a condition.

        own: (n, unknowns), with the blood volume that each run has to keep. changes: solver parameters of the runs.
        """
        carried: dict[tuple[str, int], np.ndarray] = {}
        found = own.copy()
        moved = []
        for number, (condition, point) in enumerate(wanted):
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
                carried[key] = state if source.engine is structure.engine else _transfer(source, structure, state)
            found[number] = carried[key]
            moved.append(number)
        if moved:
            volume = BloodVolume(structure.engine.model)
            numbers = np.array(moved)
            mine = {name: value[numbers] for name, value in changes.items()}
            missing = volume.evaluate(own[numbers], mine) - volume.evaluate(found[numbers], mine)
            found[numbers] = volume.with_blood_added(found[numbers], missing)
        return found


def _transfer(source: Structure, wanted: Structure, state: np.ndarray) -> np.ndarray:
    """Transfer a state to a network that differs in added elements."""
    places = source.renamed.keys() | wanted.renamed.keys()
    both = {source.renamed.get(place, place): wanted.renamed.get(place, place) for place in places}
    renamed = {old: new for old, new in both.items() if old != new}
    return carry_over(source.engine.state_names, state, wanted.engine.state_names, renamed)
