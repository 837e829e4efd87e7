"""Runs of a network with effects under all conditions: cached engines, warm starts, retries of failed runs."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.forward.fast_settling import FastSettling
from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.forward.jobs import Job, Prepared, batches, stack
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.grafting import with_elements
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.carry_over import carry_over
from coronaryuq.zerod.solver.lockstep import Computation, Run
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import Result
from coronaryuq.zerod.solver.warm_starts import Point, WarmStarts

MOST_ENGINES = 150
TOLERANCE = 1e-4
"""Cycle error of a run, well below the changes in finite differences."""
PATIENCE = 6
"""Number of cycles without halving of the cycle error after which a run has failed."""
LOOSE, MOST_CYCLES = 5e-3, 25
"""Accepted cycle error if a run cannot reach `TOLERANCE` because valves open a step earlier or later."""
NEAR_SETTLED = 0.2
"""Cycle error below which a run that did not settle is continued from its last state."""


@dataclass
class Simulation:
    """A network and its conditions; `prepared` returns the network with added elements, `waveforms` runs it.

    alter: further change of the network under a condition, for hidden cases outside the library. runs: number of runs.
    """

    network: Network
    conditions: dict[str, Condition]
    anatomy: Anatomy
    steps_per_cycle: int
    threads: int = 1
    alter: Callable[[Network, str], Network] | None = None
    runs: int = 0
    _coarse: dict[str, np.ndarray | None] = field(default_factory=dict)
    _engines: dict = field(default_factory=dict)
    _known_states: WarmStarts = field(default_factory=WarmStarts)
    _settling: FastSettling = field(default_factory=FastSettling)

    def changed(self, **fields) -> "Simulation":
        """Return a copy with other settings and new engines."""
        return replace(self, **fields, runs=0, _coarse={}, _engines={})

    def refined(self, times: int) -> "Simulation":
        """Return a copy with more time steps by a factor, whose unmodified model starts from the states of this one."""
        states = self.prepared([]).start
        return replace(self.changed(steps_per_cycle=times * self.steps_per_cycle), _coarse=states)

    def fresh(self) -> "Simulation":
        """Return a copy that knows no states, for points of another dimension."""
        return replace(self, runs=0, _engines=dict(self._engines), _known_states=WarmStarts())

    def fork(self) -> "Simulation":
        """Return a copy with the states known so far; later ones are not shared."""
        return replace(self, runs=0, _engines=dict(self._engines), _known_states=self._known_states.fork())

    def inserting(self, effects: Iterable[PlacedEffect]) -> list[PlacedEffect]:
        """Return the effects that add elements to the network."""
        return [placed for placed in effects if placed.effect.inserts(placed.place, self.anatomy)]

    def structure(self, effects: Iterable[PlacedEffect]) -> tuple[Network, dict[str, str]]:
        """Return the network with the elements of the effects, and old → new names of locations."""
        own = self.anatomy
        return with_elements(self.network, effects, lambda found: Anatomy(found, own.pressure, own.flow, own.period))

    def prepared(self, effects: Iterable[PlacedEffect]) -> Prepared:
        """Return the network with the elements of the effects, from the cache if possible."""
        inserted = self.inserting(effects)
        key = tuple(sorted(placed.key for placed in inserted))
        if key not in self._engines:
            if len(self._engines) > MOST_ENGINES:
                self._engines.clear()
            structure, renamed = self.structure(inserted)
            networks = {name: apply_condition(structure, condition) for name, condition in self.conditions.items()}
            if self.alter is not None:
                networks = {name: self.alter(network, name) for name, network in networks.items()}
            prepared = Prepared(networks, renamed)
            prepared.start = self._starts(prepared, inserted)
            self._engines[key] = prepared
        return self._engines[key]

    def _starts(self, prepared: Prepared, inserted: list[PlacedEffect]) -> dict[str, np.ndarray | None]:
        """Periodic states of the conditions without effects; a changed structure takes them over by name."""
        if inserted and self.alter is None:
            plain = self.prepared([])
            return {
                name: None
                if state is None
                else carry_over(plain.engine.state_names, state, prepared.engine.state_names, prepared.renamed)
                for name, state in plain.start.items()
            }
        prepared.start = dict.fromkeys(prepared.networks)
        known = [self._coarse.get(name) for name in prepared.networks]
        nominal = prepared.engine.run_to_periodic(
            stack(prepared, [Job(Point(np.zeros(0), {}), name) for name in prepared.networks]),
            periodicity=Periodicity(tolerance=TOLERANCE),
            steps_per_cycle=self.steps_per_cycle,
            start=None if any(state is None for state in known) else np.array(known),
        )
        self.runs += len(prepared.networks)
        settled = nominal.cycle_error < LOOSE
        return {name: nominal.state[i] if settled[i] else None for i, name in enumerate(prepared.networks)}

    def waveforms(
        self, prepared: Prepared, jobs: list[Job], names: list[str], tolerance: float = TOLERANCE
    ) -> Computation[dict[str, np.ndarray]]:
        """Return waveforms name → (jobs, steps + 1), NaN if a run failed; identical jobs share a run.

        tolerance: cycle error of the runs.
        """
        seat: dict[tuple, int] = {}
        seats = [seat.setdefault(job.key, len(seat)) for job in jobs]
        found = yield from self._run_each(prepared, [jobs[seats.index(k)] for k in range(len(seat))], names, tolerance)
        return {name: waves[seats] for name, waves in found.items()}

    def own_starts(self, prepared: Prepared, jobs: list[Job]) -> np.ndarray | None:
        """Return where each run starts: the unmodified model's state with the run's blood; None if that does not run.

        A closed loop conserves the blood volume that it starts with: that of the unmodified model's state under the
        condition, with the parameters of the run, times its factor. Shape (n, unknowns).
        """
        states = [prepared.start[job.condition] for job in jobs]
        if any(state is None for state in states):
            return None
        own, factors = np.array(states), np.array([job.blood for job in jobs])
        if np.all(factors == 1.0):
            return own
        volume = BloodVolume(prepared.engine.model)
        return volume.with_blood_added(own, (factors - 1.0) * volume.evaluate(own, stack(prepared, jobs)))

    def _run_each(
        self, prepared: Prepared, jobs: list[Job], names: list[str], wanted: float
    ) -> Computation[dict[str, np.ndarray]]:
        self.runs += len(jobs)
        found = {name: np.full((len(jobs), self.steps_per_cycle + 1), np.nan) for name in names}
        own = self.own_starts(prepared, jobs)
        for numbers in batches(prepared, jobs):
            changes, left = stack(prepared, [jobs[i] for i in numbers]), np.array(numbers)
            start, ahead = (None if own is None else own[left]), None
            if start is not None and self._keeps:
                batch = [jobs[i] for i in numbers]
                points = [(job.condition, job.point) for job in batch]
                start = self._known_states.near(points, prepared.structure, start, changes)
                ahead = self._settling.ahead(self.prepared([]), prepared, batch, changes, self.steps_per_cycle)
            for tolerance in (wanted, LOOSE, LOOSE):
                mine = np.isin(numbers, left)
                patience = PATIENCE if tolerance == wanted else None
                options = {
                    "waveforms": names,
                    "periodicity": Periodicity(tolerance, MOST_CYCLES, patience, LOOSE, extrapolate=ahead),
                    "steps_per_cycle": self.steps_per_cycle,
                    "start": start,
                }
                result = yield Run(prepared.engine, {name: value[mine] for name, value in changes.items()}, options)
                for name in names:
                    found[name][left] = result.waveforms[name]
                self._remember(prepared, [jobs[i] for i in left], result)
                again = tolerance == LOOSE
                start = None if own is None else own[left[~result.ok]] if again else _retry_states(result, own[left])
                # Runs that do not settle are retried without extrapolation of the slow modes.
                left, ahead = left[~result.ok], None
                if not left.size:
                    break
        return found

    @property
    def _keeps(self) -> bool:
        """Whether states and modes are reused in later runs; an open loop forgets its initial state."""
        return self.anatomy.closed_loop and self.alter is None

    def _remember(self, prepared: Prepared, jobs: list[Job], result: Result) -> None:
        if self._keeps:
            for job, ok, state in zip(jobs, result.ok, result.state, strict=True):
                if ok:
                    self._known_states.keep(job.condition, job.point, prepared.structure, state)


def _retry_states(result: Result, own: np.ndarray) -> np.ndarray:
    """Return initial states for retries: the last state if nearly settled, else the unmodified model's."""
    failed = ~result.ok
    near = result.cycle_error[failed] < NEAR_SETTLED
    return np.where(near[:, None], result.state[failed], own[failed])
