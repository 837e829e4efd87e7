"""Single runs of a network: what each changes in it, and the changes of many runs as the engine takes them."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.discrepancy.data.conditions import LOSS
from coronaryuq.discrepancy.forward.network_values import differences, scalars
from coronaryuq.discrepancy.forward.warm_starts import Point, Structure
from coronaryuq.zerod.effects.base import WAVE_POINTS, sampled
from coronaryuq.zerod.solver.engine import Engine

Scaled = dict[str, list[int]]
""" "BLOCK.parameter" → the factors that multiply its value, by number and in that order."""


class Prepared:
    """One structure: an engine that serves every condition, what each condition changes in it, and where runs start.

    networks, values: the network under each condition and its numbers, "BLOCK.parameter" → value.
    changes: of each condition against the engine's own network. start: periodic state (unknowns,) of each
    condition's own values, where every sample starts, so that in a closed loop all hold the blood that the model as
    it is holds.
    """

    def __init__(self, networks: dict[str, dict], renamed: dict[str, str]):
        own = next(iter(networks.values()))
        self.engine = Engine(own)
        self.networks, self.renamed = networks, renamed
        self.values = {name: scalars(network) for name, network in networks.items()}
        self.changes = {name: differences(own, network) for name, network in networks.items()}
        self.start: dict[str, np.ndarray | None] = {}

    @property
    def structure(self) -> Structure:
        return Structure(self.engine, self.renamed)

    def own(self, condition: str, name: str) -> np.ndarray | float:
        """A number of the network under a condition, as the engine takes it, or a waveform (WAVE_POINTS,)."""
        for numbers in (self.changes[condition], self.engine.parameters):
            if name in numbers:
                return numbers[name]
        return sampled(self.engine.model.network, name)


@dataclass(frozen=True)
class Job:
    """One run: a point under one condition, with what it changes in the condition's network.

    effects: values that effects give, numbers or waveforms. factors: (k,) of recalibration. scaled: what they multiply,
    the same for all jobs of a condition that run together.
    """

    point: Point
    condition: str
    effects: dict[str, np.ndarray | float] = field(default_factory=dict)
    factors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    scaled: Scaled = field(default_factory=dict)

    @property
    def key(self) -> tuple:
        """What tells two runs apart: tissue masses and other conditions' parameters need none of their own."""
        effects = ((name, np.asarray(value).tobytes()) for name, value in self.effects.items())
        return self.condition, self.factors.tobytes(), *effects

    def table(self, prepared: Prepared) -> dict[str, np.ndarray | float]:
        """Everything that the run changes, "BLOCK.parameter" → value."""
        found = dict(self.effects)
        for name, numbers in self.scaled.items():
            own = prepared.own(self.condition, name)
            value = found.get(name, own)
            beside = value - own if _adds(name) else 0.0
            value = value - beside
            for number in numbers:
                value = value * self.factors[number]
            found[name] = value + beside
        return found


def batches(prepared: Prepared, jobs: list[Job]) -> list[list[int]]:
    """Jobs that switch on elements which are nought in the network go apart: their equations are harder to solve."""
    nought = {name for name, value in prepared.engine.parameters.items() if value == 0.0}
    scaled = {job.condition: job.scaled for job in jobs}
    everywhere = {condition: not nought.isdisjoint(names) for condition, names in scaled.items()}
    apart = [everywhere[job.condition] or not nought.isdisjoint(job.effects) for job in jobs]
    groups = [[i for i, other in enumerate(apart) if other is kind] for kind in (False, True)]
    return [group for group in groups if group]


def stacked(prepared: Prepared, jobs: list[Job]) -> dict[str, np.ndarray]:
    """Engine changes of all jobs, (n,) or (n, points); where a job has none, the value under its condition."""
    nominal = prepared.engine.parameters
    # Conditions that change nothing are samples too: one parameter says how many.
    some = next(name for name, value in nominal.items() if value != 0.0)
    found = {some: np.full(len(jobs), nominal[some])}
    at: dict[str, list[int]] = {}
    for number, job in enumerate(jobs):
        at.setdefault(job.condition, []).append(number)
    scaled = {condition: jobs[numbers[0]].scaled for condition, numbers in at.items()}
    names = dict.fromkeys(name for condition in at for name in (*prepared.changes[condition], *scaled[condition]))
    for name in names | dict.fromkeys(name for job in jobs for name in job.effects):
        found[name] = np.empty(len(jobs) if name in nominal else (len(jobs), WAVE_POINTS))
        for condition, numbers in at.items():
            found[name][numbers] = prepared.own(condition, name)
    for number, job in enumerate(jobs):
        for name, value in job.effects.items():
            found[name][number] = _even(value) if np.ndim(value) else value
    for condition, numbers in at.items():
        factors = np.array([jobs[number].factors for number in numbers])
        for name, columns in scaled[condition].items():
            beside = found[name][numbers] - prepared.own(condition, name) if _adds(name) else 0.0
            found[name][numbers] -= beside
            for column in columns:
                found[name][numbers] *= factors[:, column]
            found[name][numbers] += beside
    return found


def _adds(name: str) -> bool:
    """Whether recalibration scales the condition's own value alone, beside what effects add to it: the severity of a
    stenosis is of one condition, an effect has one size under all.
    """
    return name.endswith(f".{LOSS}")


def _even(values: np.ndarray) -> np.ndarray:
    """A waveform on an even grid, on the grid of `WAVE_POINTS` points."""
    values = np.asarray(values, dtype=float)
    if len(values) == WAVE_POINTS:
        return values
    return np.interp(np.linspace(0.0, 1.0, WAVE_POINTS), np.linspace(0.0, 1.0, len(values)), values)
