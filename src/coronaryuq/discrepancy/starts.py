"""Where runs of a closed loop start: at the nearest periodic state met before, holding the blood they have to hold."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.networks import carried_over
from coronaryuq.zerod.blood_volume import BloodVolume
from coronaryuq.zerod.engine import Engine

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

    def distance(self, other: "Point") -> float:
        found = float(np.sum((self.z - other.z) ** 2))
        for key in self.sizes.keys() | other.sizes.keys():
            if key in self.sizes and key in other.sizes:
                found += float(np.sum((self.sizes[key] - other.sizes[key]) ** 2))
            else:
                found += OTHER_EFFECT**2
        return found**0.5


@dataclass(frozen=True)
class Structure:
    """A network's engine, and where its locations were before elements were added: old → new names."""

    engine: Engine
    renamed: dict[str, str]


class Starts:
    """Periodic states (unknowns,) that runs have found, by condition.

    A closed loop keeps the blood that it starts with, and what a sample has to hold is what its parameters make of the
    state that the model as it is has under the condition. A state from elsewhere is filled up to that, or bled.
    """

    def __init__(self):
        self._known: dict[str, deque[tuple[Point, Structure, np.ndarray]]] = {}

    def keep(self, condition: str, point: Point, structure: Structure, state: np.ndarray) -> None:
        """Remember the state of a run, unless that of a near point of the same network is known."""
        known = self._known.setdefault(condition, deque(maxlen=MOST))
        if not any(one.engine is structure.engine and other.distance(point) < NEAR for other, one, _ in known):
            known.append((point, structure, state))

    def near(
        self, conditions: Sequence[str], points: Sequence[Point], structure: Structure, own: np.ndarray, changes: dict
    ) -> np.ndarray:
        """Starts (n, unknowns) of runs at `points`. own: (n, unknowns), starts by the model as it is; changes: the
        runs' parameters, as the engine takes them.
        """
        found, carried = own.copy(), {}
        origin: dict[int, int | None] = {}
        for number, (condition, point) in enumerate(zip(conditions, points, strict=True)):
            known = self._known.get(condition, ())
            distances = [other.distance(point) for other, _, _ in known]
            if not distances or min(distances) >= Point(np.zeros_like(point.z), {}).distance(point):
                continue
            best = int(np.argmin(distances))
            key = condition, best
            if key not in carried:
                _, source, state = known[best]
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
