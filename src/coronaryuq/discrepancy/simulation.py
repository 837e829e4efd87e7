"""Runs of a network with effects put in, under all conditions: engines kept, starts near, failed runs tried again."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.discrepancy.conditions import Condition, under
from coronaryuq.discrepancy.networks import WAVE_POINTS, carried_over, differences, sampled, scalars
from coronaryuq.discrepancy.starts import Point, Starts, Structure
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.engine import Engine
from coronaryuq.zerod.result import Result

Acting = tuple[Effect, str]
"""An effect at a place."""

MOST_ENGINES = 150
TOLERANCE = 1e-4
"""Cycle error of a run: well below the change that a finite difference of the sensitivities looks for."""

PATIENCE = 6
"""Cycles without half the cycle error after which a run is taken not to settle any closer."""
LOOSE, MOST_CYCLES = 5e-3, 25
"""Cycle error that will do where valves that open a step earlier or later keep a run from settling to `TOLERANCE`."""
NEAR_SETTLED = 0.2
"""Cycle error below which a run that did not settle goes on from where it is."""


@dataclass
class Prepared:
    """One structure: an engine that serves every condition, what each condition changes in it, and where runs start.

    networks, values: the network under each condition and its numbers, "BLOCK.parameter" → value.
    changes: of each condition against the engine's own network. start: periodic state (unknowns,) of each
    condition's own values, where every sample starts, so that in a closed loop all hold the blood that the model as
    it is holds.
    """

    engine: Engine
    networks: dict[str, dict]
    values: dict[str, dict[str, float]]
    changes: dict[str, dict]
    renamed: dict[str, str]
    start: dict[str, np.ndarray | None]

    @property
    def structure(self) -> Structure:
        return Structure(self.engine, self.renamed)


@dataclass(frozen=True)
class Job:
    """One run: a point under one condition, with what it changes in the condition's network."""

    point: Point
    condition: str
    table: dict

    @property
    def key(self) -> tuple:
        """What tells two runs apart: tissue masses and other conditions' parameters need none of their own."""
        return self.condition, *((name, np.asarray(value).tobytes()) for name, value in self.table.items())


@dataclass
class Simulation:
    """A network and the conditions it runs under: `prepared` gives a structure of it, `waveforms` runs that.

    alter: a further change of the network under a condition; hidden cases outside the library use it. runs: how many
    were made.
    """

    network: dict
    conditions: dict[str, Condition]
    anatomy: Anatomy
    steps_per_cycle: int
    threads: int = 1
    alter: Callable[[dict, str], dict] | None = None
    runs: int = 0
    _engines: dict = field(default_factory=dict)
    _met: Starts = field(default_factory=Starts)

    def changed(self, **fields) -> "Simulation":
        """The same with other steps, or another change of the network: engines are made anew."""
        return replace(self, **fields, runs=0, _engines={})

    def inserting(self, acting: Collection[Acting]) -> list[Acting]:
        """Those that add elements to the network."""
        return [(effect, place) for effect, place in acting if effect.inserts(place, self.anatomy)]

    def structure(self, acting: list[Acting]) -> tuple[dict, dict[str, str]]:
        """The rest network with the elements of the acting effects, and old → new names of locations."""
        network, renamed = self.network, {}
        for effect, place in acting:
            anatomy = Anatomy(network, self.anatomy.pressure, self.anatomy.flow, self.anatomy.period)
            fresh = effect.aliases(place, anatomy)
            network = effect.insert(network, place, anatomy)
            renamed = {old: fresh.get(new, new) for old, new in renamed.items()} | {
                old: new for old, new in fresh.items() if old not in renamed.values()
            }
        return network, renamed

    def prepared(self, acting: list[Acting]) -> Prepared:
        inserted = self.inserting(acting)
        key = elements(inserted)
        if key not in self._engines:
            if len(self._engines) > MOST_ENGINES:
                self._engines.clear()
            structure, renamed = self.structure(inserted)
            networks = {name: under(structure, condition) for name, condition in self.conditions.items()}
            if self.alter is not None:
                networks = {name: self.alter(network, name) for name, network in networks.items()}
            own = next(iter(networks.values()))
            values = {name: scalars(network) for name, network in networks.items()}
            changes = {name: differences(own, network) for name, network in networks.items()}
            prepared = Prepared(Engine(own), networks, values, changes, renamed, {})
            prepared.start = self._starts(prepared, inserted)
            self._engines[key] = prepared
        return self._engines[key]

    def _starts(self, prepared: Prepared, inserted: list[Acting]) -> dict[str, np.ndarray | None]:
        """Periodic states of the conditions' own values; a changed structure takes them over by name."""
        if inserted and self.alter is None:
            plain = self.prepared([])
            return {
                name: None
                if state is None
                else carried_over(plain.engine.state_names, state, prepared.engine.state_names, prepared.renamed)
                for name, state in plain.start.items()
            }
        prepared.start = dict.fromkeys(prepared.networks)
        nominal = prepared.engine.run(
            _stack(prepared, [Job(Point(np.zeros(0), {}), name, {}) for name in prepared.networks]),
            periodic=True,
            steps_per_cycle=self.steps_per_cycle,
            tolerance=TOLERANCE,
        )
        self.runs += len(prepared.networks)
        settled = nominal.cycle_error < LOOSE
        return {name: nominal.state[i] if settled[i] else None for i, name in enumerate(prepared.networks)}

    def waveforms(self, prepared: Prepared, jobs: list[Job], names: list[str]) -> dict[str, np.ndarray]:
        """Waveforms name → (jobs, steps + 1); NaN where a run failed."""
        seat: dict[tuple, int] = {}
        seats = [seat.setdefault(job.key, len(seat)) for job in jobs]
        found = self._run_each(prepared, [jobs[seats.index(k)] for k in range(len(seat))], names)
        return {name: waves[seats] for name, waves in found.items()}

    def _run_each(self, prepared: Prepared, jobs: list[Job], names: list[str]) -> dict[str, np.ndarray]:
        self.runs += len(jobs)
        found = {name: np.full((len(jobs), self.steps_per_cycle + 1), np.nan) for name in names}
        starts = [prepared.start[job.condition] for job in jobs]
        own = None if any(state is None for state in starts) else np.array(starts)
        for numbers in _batches(prepared, jobs):
            changes, left = _stack(prepared, [jobs[i] for i in numbers]), np.array(numbers)
            start = None if own is None else self._start(prepared, [jobs[i] for i in numbers], own[left], changes)
            for tolerance in (TOLERANCE, LOOSE, LOOSE):
                mine = np.isin(numbers, left)
                result = prepared.engine.run(
                    {name: value[mine] for name, value in changes.items()},
                    waveforms=names,
                    periodic=True,
                    cycles=MOST_CYCLES,
                    steps_per_cycle=self.steps_per_cycle,
                    tolerance=tolerance,
                    patience=PATIENCE if tolerance == TOLERANCE else None,
                    start=start,
                    threads=self.threads,
                )
                for name in names:
                    found[name][left] = result.waveforms[name]
                self._remember(prepared, [jobs[i] for i in left], result)
                again = tolerance == LOOSE
                start = None if own is None else own[left[~result.ok]] if again else _from_there(result, own[left])
                left = left[~result.ok]
                if not left.size:
                    break
        return found

    def _start(self, prepared: Prepared, jobs: list[Job], own: np.ndarray, changes: dict) -> np.ndarray:
        """Where the runs start; in an open loop, which forgets, by the model as it is."""
        if not self.anatomy.closed_loop or self.alter is not None:
            return own
        conditions, points = [job.condition for job in jobs], [job.point for job in jobs]
        return self._met.near(conditions, points, prepared.structure, own, changes)

    def _remember(self, prepared: Prepared, jobs: list[Job], result: Result) -> None:
        if self.anatomy.closed_loop and self.alter is None:
            for job, ok, state in zip(jobs, result.ok, result.state, strict=True):
                if ok:
                    self._met.keep(job.condition, job.point, prepared.structure, state)


def elements(inserted: list[Acting]) -> tuple:
    """What tells the structure of a network with these effects from that of another."""
    return tuple((effect.name, place) for effect, place in inserted)


def _batches(prepared: Prepared, jobs: list[Job]) -> list[list[int]]:
    """Jobs that switch on elements which are nought in the network go apart: their equations are harder to solve."""
    nominal = prepared.engine.parameters
    apart = [any(nominal.get(name) == 0.0 for name in job.table) for job in jobs]
    groups = [[i for i, other in enumerate(apart) if other is kind] for kind in (False, True)]
    return [group for group in groups if group]


def _from_there(result: Result, own: np.ndarray) -> np.ndarray:
    """Starts of a second attempt of the runs that failed: where the first ended, if it was near to settling."""
    failed = ~result.ok
    near = result.cycle_error[failed] < NEAR_SETTLED
    return np.where(near[:, None], result.state[failed], own[failed])


def _stack(prepared: Prepared, jobs: list[Job]) -> dict[str, np.ndarray]:
    """Engine changes of all jobs, (n,) or (n, points); where a job has none, the value under its condition."""
    tables = [{**prepared.changes[job.condition], **job.table} for job in jobs]
    nominal = prepared.engine.parameters
    # Conditions that change nothing are samples too: one parameter says how many.
    some = next(name for name, value in nominal.items() if value != 0.0)
    found = {some: np.full(len(jobs), nominal[some])}
    for name in dict.fromkeys(name for table in tables for name in table):
        if name in nominal:
            found[name] = np.array([table.get(name, nominal[name]) for table in tables], dtype=float)
        else:
            own = sampled(next(iter(prepared.networks.values())), name)
            found[name] = np.array([_even(table[name]) if name in table else own for table in tables])
    return found


def _even(values: np.ndarray) -> np.ndarray:
    """A waveform on an even grid, on the grid of `WAVE_POINTS` points."""
    values = np.asarray(values, dtype=float)
    if len(values) == WAVE_POINTS:
        return values
    return np.interp(np.linspace(0.0, 1.0, WAVE_POINTS), np.linspace(0.0, 1.0, len(values)), values)
