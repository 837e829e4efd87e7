"""Single runs of a network, and the solver parameters of many runs stacked for one batch."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.discrepancy.forward.nuisance import BLOOD
from coronaryuq.zerod.network.differences import LOSS, differences, scalars
from coronaryuq.zerod.network.waveforms import WAVE_POINTS, resampled, sampled
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.warm_starts import Point, Structure

Value = float | np.ndarray
"""Of one run, or of each of several."""
Scaled = dict[str, list[int]]
""" "BLOCK.parameter", or `BLOOD`, → numbers of the factors that multiply its value, in that order."""


class Prepared:
    """One network structure: an engine for all conditions, their changes, and their initial states.

    networks, values: the network under each condition and its numbers, "BLOCK.parameter" → value.
    changes: solver parameters of each condition that differ from the engine's network. start: periodic state
    (unknowns,) of each condition without effects, where every sample starts.
    """

    def __init__(self, networks: dict[str, Network], renamed: dict[str, str]):
        own = next(iter(networks.values()))
        self.engine = Engine(own)
        self.networks, self.renamed = networks, renamed
        self.values = {name: scalars(network) for name, network in networks.items()}
        self.changes = {name: differences(own, network) for name, network in networks.items()}
        self.start: dict[str, np.ndarray | None] = {}

    @cached_property
    def topology(self) -> Topology:
        """Vessels of the structure, which all conditions share."""
        return Topology(next(iter(self.networks.values())))

    @property
    def structure(self) -> Structure:
        return Structure(self.engine, self.renamed)

    def own(self, condition: str, name: str) -> np.ndarray | float:
        """Return a parameter of the network under a condition: a number or a waveform (WAVE_POINTS,)."""
        for numbers in (self.changes[condition], self.engine.parameters):
            if name in numbers:
                return numbers[name]
        return sampled(self.engine.model.network, name)


@dataclass(frozen=True)
class Job:
    """One run: a point under one condition, with its changes of the condition's network.

    effects: values set by effects, numbers or waveforms. factors: (k,) of recalibration. scaled: the values that they
    multiply, the same for all jobs of a condition in one batch.
    """

    point: Point
    condition: str
    effects: dict[str, np.ndarray | float] = field(default_factory=dict)
    factors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    scaled: Scaled = field(default_factory=dict)

    @property
    def key(self) -> tuple:
        """Identity of the run: tissue masses and parameters of other conditions do not require a separate run."""
        effects = ((name, np.asarray(value).tobytes()) for name, value in self.effects.items())
        return self.condition, self.factors.tobytes(), *effects

    @property
    def blood(self) -> float:
        """Factor on the blood volume of a closed loop."""
        return float(np.prod(self.factors[self.scaled.get(BLOOD, [])]))

    def table(self, prepared: Prepared) -> dict[str, np.ndarray | float]:
        """Return all changes of the run, "BLOCK.parameter" → value."""
        values = dict(self.effects)
        for name, numbers in _of_network(self.scaled).items():
            own = prepared.own(self.condition, name)
            values[name] = _scaled(name, own, values.get(name, own), self.factors[numbers])
        return values


def batches(prepared: Prepared, jobs: list[Job]) -> list[list[int]]:
    """Group jobs that run in one batch.

    Those that activate zero-valued elements are harder to solve. A waveform that one job of a batch changes is
    resampled in all, so jobs that change other waveforms are apart: no prediction depends on what runs beside it.
    """
    nominal = prepared.engine.parameters
    zero = {name for name, value in nominal.items() if value == 0.0}
    scaled = {job.condition: job.scaled for job in jobs}
    everywhere = {condition: not zero.isdisjoint(names) for condition, names in scaled.items()}
    groups: dict[tuple, list[int]] = {}
    for number, job in enumerate(jobs):
        activates = everywhere[job.condition] or not zero.isdisjoint(job.effects)
        changed = prepared.changes[job.condition].keys() | job.effects.keys()
        groups.setdefault((activates, frozenset(changed - nominal.keys())), []).append(number)
    return list(groups.values())


def stack(prepared: Prepared, jobs: list[Job]) -> dict[str, np.ndarray]:
    """Return the solver parameters of all jobs, (n,) or (n, points)."""
    nominal = prepared.engine.parameters
    # Conditions without changes are samples, too: one parameter determines their number.
    some = next(name for name, value in nominal.items() if value != 0.0)
    values = {some: np.full(len(jobs), nominal[some])}
    by_condition: dict[str, list[int]] = {}
    for number, job in enumerate(jobs):
        by_condition.setdefault(job.condition, []).append(number)
    scaled = {condition: _of_network(jobs[numbers[0]].scaled) for condition, numbers in by_condition.items()}
    names = dict.fromkeys(
        name for condition in by_condition for name in (*prepared.changes[condition], *scaled[condition])
    )
    for name in names | dict.fromkeys(name for job in jobs for name in job.effects):
        values[name] = np.empty(len(jobs) if name in nominal else (len(jobs), WAVE_POINTS))
        for condition, numbers in by_condition.items():
            values[name][numbers] = prepared.own(condition, name)
    for number, job in enumerate(jobs):
        for name, value in job.effects.items():
            values[name][number] = resampled(value) if isinstance(value, np.ndarray) and value.ndim else value
    for condition, numbers in by_condition.items():
        factors = np.array([jobs[number].factors for number in numbers])
        for name, columns in scaled[condition].items():
            own = prepared.own(condition, name)
            values[name][numbers] = _scaled(name, own, values[name][numbers], factors.T[columns])
    return values


def _of_network(scaled: Scaled) -> Scaled:
    """Return the values that recalibration multiplies, without the blood volume, which is no element's."""
    return {name: numbers for name, numbers in scaled.items() if name != BLOOD}


def _scaled(name: str, own: Value, value: Value, factors: Iterable[Value]) -> Value:
    """Return a value of a condition's network, as effects have changed it, as recalibration scales it.

    The severity of a known stenosis belongs to a condition, while an effect has one size under all conditions: so of a
    loss only the condition's own value is scaled, not what effects add.
    """
    added = value - own if name.endswith(f".{LOSS}") else 0.0
    value = value - added
    for factor in factors:
        value = value * factor
    return value + added
