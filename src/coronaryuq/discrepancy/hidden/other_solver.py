"""Runs of a network with effects by svZeroDSolver instead of our engine, for hidden cases."""

import json
from dataclasses import dataclass, field, fields

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core import provenance
from coronaryuq.discrepancy.forward.jobs import Job, Prepared, stack
from coronaryuq.discrepancy.forward.simulation import LOOSE, MOST_CYCLES, PATIENCE, TOLERANCE, Simulation
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.solver.lockstep import Computation
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.svzerodsolver.program import expressible, last_cycle

OPEN_CYCLES, CLOSED_CYCLES = 6, 2
"""Cycles of the first attempt: an open loop starts from svZeroDSolver's steady state; a closed loop from a nearly
periodic state, because only an initial state can give it the blood volume of the model."""
ATTEMPTS = 3
"""Attempts, each with three times the cycles of the one before, until a run is periodic."""
MOST_KEPT = 400
"""Runs kept for later cases: those without an effect are the same for all effects hidden in one subject."""

Waves = dict[str, np.ndarray]


@dataclass
class SvZeroDSimulation(Simulation):
    """A `Simulation` whose waveforms come from svZeroDSolver; our engine runs what it cannot express or solve.

    by_engine: number of runs by our engine.
    """

    by_engine: int = 0
    _kept: dict[str, Waves | None] = field(default_factory=dict)

    @classmethod
    def like(cls, simulation: Simulation) -> "SvZeroDSimulation":
        """Return the same simulation by svZeroDSolver."""
        return cls(**{one.name: getattr(simulation, one.name) for one in fields(Simulation)})

    def waveforms(
        self, prepared: Prepared, jobs: list[Job], names: list[str], tolerance: float = TOLERANCE
    ) -> Computation[Waves]:
        """Return waveforms name → (jobs, steps + 1), as `Simulation.waveforms` does."""
        self.runs += len(jobs)
        networks = [with_changes(prepared.networks[job.condition], job.table(prepared)) for job in jobs]
        keys = [self._key(network, job.blood, names) for network, job in zip(networks, jobs, strict=True)]
        missing = [number for number, key in enumerate(keys) if key not in self._kept]
        if len(self._kept) + len(missing) > MOST_KEPT:
            self._kept.clear()
            missing = list(range(len(jobs)))
        starts = self._periodic_states(prepared, [jobs[number] for number in missing], tolerance)
        for number, start in zip(missing, starts, strict=True):
            network = networks[number]
            self._kept[keys[number]] = self._run(network, names, start) if expressible(network) else None
        waves = [self._kept[key] for key in keys]
        found = {name: np.full((len(jobs), self.steps_per_cycle + 1), np.nan) for name in names}
        left = [number for number, wave in enumerate(waves) if wave is None]
        for number, wave in enumerate(waves):
            for name, values in (wave or {}).items():
                found[name][number] = values
        if left:
            self.by_engine += len(left)
            ours = yield from super().waveforms(prepared, [jobs[number] for number in left], names)
            for name, values in ours.items():
                found[name][left] = values
        return found

    def _periodic_states(self, prepared: Prepared, jobs: list[Job], tolerance: float) -> list[Waves | None]:
        """Return the initial state of each run of a closed loop, unknown → value and rate, nearly periodic."""
        if not jobs or not self.anatomy.closed_loop or (starts := self.own_starts(prepared, jobs)) is None:
            return [None] * len(jobs)
        settled = prepared.engine.run_to_periodic(
            stack(prepared, jobs),
            periodicity=Periodicity(tolerance, MOST_CYCLES, PATIENCE),
            steps_per_cycle=self.steps_per_cycle,
            start=starts,
        )
        unknowns = prepared.engine.unknowns
        return [
            dict(zip(unknowns, np.reshape(state[: 2 * len(unknowns)], (2, -1)).T, strict=True))
            for state in settled.state
        ]

    def _run(self, network: Network, names: list[str], start: Waves | None) -> Waves | None:
        """Return the last cycle of a periodic run, None if it fails or stays aperiodic."""
        simulation = network["simulation_parameters"] | {
            "number_of_time_pts_per_cardiac_cycle": self.steps_per_cycle + 1
        }
        network = Network({**network, "simulation_parameters": simulation})
        cycles = OPEN_CYCLES
        if start is not None:
            cycles, simulation["steady_initial"] = CLOSED_CYCLES, False
            network["initial_condition"] = {name: float(value) for name, (value, _) in start.items()}
            network["initial_condition_d"] = {name: float(rate) for name, (_, rate) in start.items()}
        for attempt in range(ATTEMPTS):
            simulation["number_of_cardiac_cycles"] = cycles * 3**attempt
            try:
                waves = last_cycle(network, names)
            except RuntimeError:
                return None
            spans = {name: max(np.ptp(wave), 1e-6 * np.abs(wave).max()) for name, wave in waves.items()}
            errors = [abs(wave[-1] - wave[0]) / spans[name] for name, wave in waves.items() if spans[name] > 0.0]
            tolerance = LOOSE if attempt == ATTEMPTS - 1 else TOLERANCE
            if max(errors, default=0.0) < tolerance:
                return waves
        return None

    def _key(self, network: Network, blood: float, names: list[str]) -> str:
        return provenance.digest([json.dumps(network), blood, sorted(names), self.steps_per_cycle])
