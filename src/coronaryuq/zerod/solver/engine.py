"""The 0D engine: many parameter sets of one network at once, with the numbers of svZeroDSolver."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network import output_names as named
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.solver.assembly import Context
from coronaryuq.zerod.solver.batch import Batch
from coronaryuq.zerod.solver.elements import coronary_offset
from coronaryuq.zerod.solver.kernels import Scheme, march
from coronaryuq.zerod.solver.lane_tables import fill
from coronaryuq.zerod.solver.lanes import LANES, table
from coronaryuq.zerod.solver.periodic import Anderson, Periodicity, drift
from coronaryuq.zerod.solver.result import OK, Result
from coronaryuq.zerod.solver.tables import Program, make_program, write_elements
from coronaryuq.zerod.solver.threads import workers

_WRITTEN = 8
"""Groups whose elements are written together: a term costs as much for one sample as for a hundred."""
_STEADY_STEPS, _STEADY_STEPS_PER_CYCLE = 31, 10
_REFINEMENTS = (1, 2, 4, 8)

COARSER, LEAST_COARSE = 4, 100
"""How much longer the steps of the approach from a neighbour are, and how many of them a cycle needs at least."""

_COARSE_CYCLES = 8
_NEAR = 0.2
"""Cycle error below which a state still has to do with the periodic state that it came from."""

Changes = Mapping[str, "np.ndarray | float"]


class Engine:
    """One network, analysed once, run for many samples.

    network: as from `read_network`. file: name for error messages. Raises `InputError` for a network that is
    inconsistent or singular. The time scheme is generalised-α with the network's `rho_infty`, Newton stops at the
    network's `absolute_tolerance` in max|residual|: both as svZeroDSolver.
    """

    def __init__(self, network: Network, file: str | Path = "network"):
        self.model = Model(network, file)
        simulation = self.model.simulation
        if simulation.get("coupled_simulation", False):
            remedy = "is driven by a 3D solver; set false"
            raise InputError(file, "simulation_parameters.coupled_simulation", True, remedy)
        rho = simulation.get("rho_infty", 0.5)
        alpha_m, alpha_f = 0.5 * (3.0 - rho) / (1.0 + rho), 1.0 / (1.0 + rho)
        self.scheme = Scheme(
            alpha_m,
            alpha_f,
            0.5 + alpha_m - alpha_f,
            float(simulation.get("absolute_tolerance", 1e-8)),
            int(simulation.get("maximum_nonlinear_iterations", 30)),
        )
        self.steps_per_cycle = int(simulation["number_of_time_pts_per_cardiac_cycle"]) - 1
        self.cycles = int(simulation["number_of_cardiac_cycles"])
        self.coronaries = [b for b in self.model.blocks.values() if b.kind in ("CORONARY", "CORONARY_VAR_RES")]
        self._programs: dict[tuple, Program] = {}
        self._counterparts: dict[tuple, np.ndarray | None] = {}

    @property
    def unknowns(self) -> list[str]:
        """Names of the unknowns, svZeroDSolver's, in its order."""
        return self.model.variables

    @property
    def parameters(self) -> dict[str, float]:
        """Every scalar that `changes` may name, with the network's own value."""
        return self.model.parameters

    @property
    def waveforms(self) -> list[str]:
        """Every waveform that `changes` may name: "BLOCK.P", "BLOCK.Q" or "BLOCK.Pim"."""
        return [f"{block.name}.{name}" for block in self.model.blocks.values() for name in block.series]

    @property
    def state_names(self) -> list[str]:
        """Columns of `Result.state`: unknowns, their rates, and the reference pressure of each open-loop coronary."""
        rates = [f"d_{name}" for name in self.model.variables]
        return [*self.model.variables, *rates, *(f"offset:{block.name}" for block in self.coronaries)]

    def run_cycles(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        cycles: int | None = None,
        steps_per_cycle: int | None = None,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result:
        """March a batch of samples through a number of cycles and measure the last one.

        Parameters
        ----------
        changes : mapping of str to array
            "BLOCK.parameter" → (samples,) or scalar; "BLOCK.waveform" → (samples, points) on an even grid over the
            cycle, both ends included. What it does not name keeps the network's value.
        quantities : sequence of str
            Statistics of the last cycle such as `mean_flow:A:B`, see `network.output_names`.
        waveforms : sequence of str
            Unknowns such as `flow:A:B` whose last cycle is kept.
        cycles : int, optional
            The network's number by default.
        steps_per_cycle : int, optional
            The network's number by default.
        start : array, (columns,) or (samples, columns), optional
            A `Result.state`; by default the network's own initial condition, steady if it says so. A closed loop keeps
            the blood volume that it starts with.
        threads : int
            Threads over groups of samples; results do not depend on it.

        Returns
        -------
        Result
            A sample that fails has a reason in `status`, and NaN.

        Raises
        ------
        InputError
            If the network lacks what a name refers to, or if a value has the wrong shape or is not finite.
        """
        return self._run(
            changes or {}, quantities, waveforms, start, self._steps(steps_per_cycle), threads, cycles or self.cycles
        )

    def run_to_periodic(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        periodicity: Periodicity | None = None,
        steps_per_cycle: int | None = None,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result:
        """March a batch until each sample is periodic and measure its last cycle.

        Parameters
        ----------
        changes, quantities, waveforms, steps_per_cycle, threads
            As in `run_cycles`.
        periodicity : Periodicity, optional
            When a sample counts as periodic, and how to get there.
        start : array, (columns,) or (samples, columns), optional
            As in `run_cycles`. One start for all is taken for the network's own periodic state, from which samples are
            first approached with longer time steps; those cycles are not counted.

        Returns
        -------
        Result
            As in `run_cycles`; a sample that does not become periodic fails.

        Raises
        ------
        InputError
            As in `run_cycles`.
        """
        periodicity, steps = periodicity or Periodicity(), self._steps(steps_per_cycle)
        if periodicity.accelerate and start is not None and np.ndim(start) == 1:
            _, samples = self._parameters(changes or {}, start)
            start = self._approached(changes or {}, self._whole(start, samples), steps, periodicity.tolerance, threads)
        return self._run(changes or {}, quantities, waveforms, start, steps, threads, periodicity.cycles, periodicity)

    def _steps(self, steps_per_cycle: int | None) -> int:
        return self.steps_per_cycle if steps_per_cycle is None else int(steps_per_cycle)

    def _run(
        self,
        changes: Changes,
        quantities: Sequence[str],
        waveforms: Sequence[str],
        start: np.ndarray | None,
        steps: int,
        threads: int,
        limit: int,
        periodicity: Periodicity | None = None,
    ) -> Result:
        values, samples = self._parameters(changes, start)
        wanted = [named.parse(name, self.model) for name in quantities]
        shown = [named.unknown(name, self.model) for name in waveforms]
        recorded = np.unique(np.array([q.unknown for q in wanted] + shown, dtype=np.int64))
        result = Result.blank(samples, steps, self.model.period, len(self.state_names), quantities, waveforms)
        whole = None if start is None else self._whole(start, samples)
        tolerance = None if periodicity is None else periodicity.tolerance
        left = np.arange(samples)
        for refinement in _REFINEMENTS:
            part = {name: value[left] if np.ndim(value) else value for name, value in values.items()}
            batch = self._begin(part, len(left), None if whole is None else whole[left], threads)
            batch.make_room(recorded, steps * refinement, bool(shown))
            spent, error, solves = self._march(batch, steps * refinement, limit, threads, periodicity, left)
            statuses = [_status(*ended, tolerance) for ended in zip(batch.failed_at, error, spent, strict=True)]
            good = np.array([status == OK for status in statuses])
            statistics = dict(zip(named.STATISTICS, batch.statistics, strict=True))
            for name, quantity in zip(quantities, wanted, strict=True):
                column = statistics[quantity.statistic][:, np.searchsorted(recorded, quantity.unknown)]
                result.values[name][left] = np.where(good, column, np.nan)
            for name, unknown in zip(waveforms, shown, strict=True):
                wave = batch.waves[np.searchsorted(recorded, unknown), :, ::refinement]
                result.waveforms[name][left] = np.where(good[:, None], wave, np.nan)
            result.state[left] = np.concatenate([batch.state, batch.offsets], axis=1)
            result.status[left], result.refinement[left] = statuses, refinement
            result.cycles[left], result.cycle_error[left] = spent, error
            result.solves += solves
            left = left[batch.failed_at > 0]
            if not left.size:
                break
        return result

    def histories(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Run the network's own sample cycle by cycle, without end: y and ẏ at every step, (steps + 1, unknowns) each.

        Raises
        ------
        RuntimeError
            If Newton's method does not converge.
        """
        n, steps = self.model.size, self.steps_per_cycle
        batch = self._begin({}, 1, None, 1)
        program = self._fill(batch, steps, steady=False)
        while True:
            batch.make_room(np.arange(2 * n), steps, True)
            self._cycle(program, batch, np.ones(1, bool), steps, steps, 1)
            batch.keep_waves(np.ones(1, bool))
            if batch.failed_at[0]:
                raise RuntimeError(_status(batch.failed_at[0], 0.0, 1))
            yield batch.waves[:n, 0].T, batch.waves[n:, 0].T

    def _parameters(self, changes: Changes, start) -> tuple[dict[str, np.ndarray], int]:
        known, waveforms = self.parameters, set(self.waveforms)
        sizes = {np.shape(value)[0] for value in changes.values() if np.ndim(value)}
        if start is not None and np.ndim(start) == 2:
            sizes.add(np.shape(start)[0])
        if len(sizes) > 1:
            raise InputError(self.model.file, "changes", sorted(sizes), "all arrays must have one length, the samples")
        values = {}
        for name, value in changes.items():
            value = np.asarray(value, float)
            if name in waveforms:
                if value.ndim != 2 or value.shape[1] < 2:
                    raise InputError(self.model.file, name, value.shape, "want a waveform per sample, (n, points)")
            elif name not in known:
                raise InputError(self.model.file, name, None, "no such scalar parameter in the network")
            elif value.ndim > 1:
                raise InputError(self.model.file, name, value.shape, "want one number per sample, (n,)")
            if not np.all(np.isfinite(value)):
                raise InputError(self.model.file, name, "nan or inf", "want finite numbers")
            values[name] = value
        return values, sizes.pop() if sizes else 1

    def _whole(self, start: np.ndarray, samples: int) -> np.ndarray:
        start = np.atleast_2d(np.asarray(start, float))
        width = len(self.state_names)
        if start.shape[1] != width:
            raise InputError(self.model.file, "start", start.shape[1], f"want {width} columns, a state of this network")
        return np.broadcast_to(start, (samples, width))

    def _approached(
        self, changes: Changes, start: np.ndarray, steps: int, tolerance: float, threads: int
    ) -> np.ndarray:
        """Return initial states (n, columns of state): `start` plus the change that `COARSER` steps predict.

        `start` is a periodic state of the network itself. The change is that of its counterpart on the longer steps,
        from the network's parameters to the sample's.
        """
        coarse = steps // COARSER
        if coarse < LEAST_COARSE:
            return start
        key = start[0].tobytes(), steps, tolerance
        if key not in self._counterparts:
            first = self.run_cycles(cycles=1, steps_per_cycle=coarse, start=start[:1], threads=threads)
            near = first.ok[0] and first.cycle_error[0] < _NEAR
            options = Periodicity(tolerance, cycles=_COARSE_CYCLES)
            found = (
                self.run_to_periodic(periodicity=options, steps_per_cycle=coarse, start=first.state, threads=threads)
                if near
                else first
            )
            self._counterparts = {key: found.state if found.cycle_error[0] < 10.0 * tolerance else None}
        counterpart = self._counterparts[key]
        if counterpart is None:
            return start
        begin = np.broadcast_to(counterpart, start.shape)
        found = self.run_to_periodic(
            changes,
            periodicity=Periodicity(10.0 * tolerance, cycles=_COARSE_CYCLES),
            steps_per_cycle=coarse,
            start=begin,
            threads=threads,
        )
        return np.where(found.cycle_error[:, None] < _NEAR, start + (found.state - begin), start)

    def _program(self, changed: Mapping, steady: bool) -> Program:
        nominal = self.parameters
        zero = frozenset(name for name in changed if nominal.get(name) == 0.0)
        key = zero, steady
        if key not in self._programs:
            # Pivots are judged at the network's own steps, so that no run depends on what ran before it.
            times = _STEADY_STEPS_PER_CYCLE if steady else self.steps_per_cycle
            at, own = (
                Context(self.model, dict.fromkeys(names, np.ones(1)), 1, self._phases(times), steady)
                for names in (zero, ())
            )
            self._programs[key] = make_program(self.model, at, self.scheme, self.model.period / times, own)
        return self._programs[key]

    def _phases(self, times: int) -> np.ndarray:
        return (np.arange(times) + self.scheme.alpha_f) / times

    def _fill(self, batch: Batch, times: int, steady: bool) -> Program:
        """Tables of the batch's groups, each filled from its own samples only."""
        samples = len(batch.state)
        program = self._program(batch.parameters, steady)
        batch.groups, batch.seats = [], []
        for first in range(0, samples, _WRITTEN * LANES):
            part = slice(first, min(first + _WRITTEN * LANES, samples))
            size = part.stop - part.start
            parameters = {k: v[part] if np.ndim(v) else v for k, v in batch.parameters.items()}
            offsets = {block.name: batch.offsets[part, k] for k, block in enumerate(self.coronaries)}
            at = Context(self.model, parameters, size, self._phases(times), steady, offsets)
            system = write_elements(self.model, at)
            for begin in range(0, size, LANES):
                seats = slice(begin, min(begin + LANES, size))
                batch.seats.append(np.arange(first + seats.start, first + seats.stop))
                batch.groups.append(fill(program, system, at.period, times, self.scheme, seats))
        return program

    def _begin(self, parameters: dict, samples: int, start: np.ndarray | None, threads: int) -> Batch:
        n = self.model.size
        offsets, state = (np.ones((samples, len(self.coronaries))), np.zeros((samples, 2 * n)))
        batch = Batch(parameters, offsets, state, np.zeros(samples))
        if start is not None:
            batch.state, batch.offsets = (start[:, : 2 * n].copy(), start[:, 2 * n :].copy())
            return batch
        batch.state[:] = self._initial_condition()
        steady = self.model.simulation.get("steady_initial", True)
        if steady:
            program = self._fill(batch, _STEADY_STEPS_PER_CYCLE, steady=True)
            batch.make_room(np.empty(0, np.int64), _STEADY_STEPS, False)
            self._cycle(program, batch, np.ones(samples, bool), _STEADY_STEPS, _STEADY_STEPS_PER_CYCLE, threads)
        at = Context(self.model, parameters, samples, np.zeros(1))
        for k, block in enumerate(self.coronaries):
            batch.offsets[:, k] = coronary_offset(block, at, batch.state[:, :n], batch.state[:, n:], steady)
        return batch

    def _initial_condition(self) -> np.ndarray:
        n, state = self.model.size, np.zeros(2 * self.model.size)
        given = self.model.network.get("initial_condition", {})
        for k, name in enumerate(self.model.variables):
            default = 0.0
            if name.startswith(("pressure:", "P_c:")):
                default = given.get("pressure_all", 0.0)
            elif name.startswith("flow:"):
                default = given.get("flow_all", 0.0)
            state[k] = given.get(name, default)
            state[n + k] = self.model.network.get("initial_condition_d", {}).get(name, 0.0)
        return state

    def _cycle(self, program: Program, batch: Batch, live: np.ndarray, steps: int, times: int, threads: int) -> int:
        """March the samples of `live` (n,) through `steps` steps; returns Newton solves, summed over groups."""
        size = self.model.size

        def advance(number: int) -> int:
            group, seats, record = batch.groups[number], batch.seats[number], batch.records[number]
            real = np.arange(LANES) < len(seats)
            lanes = np.where(real, np.resize(seats, LANES), seats[0])
            real &= live[lanes]
            state, failed, counts = table(2 * size), table(1), np.zeros(1, np.int64)
            state[:] = batch.state[lanes].T
            failed[0] = np.where(live[lanes], batch.failed_at[lanes], 1.0)
            march(program.structure, group.values, group.work, state, self.scheme, steps, times, failed, record, counts)
            mine = lanes[real]
            batch.state[mine] = state.T[real]
            batch.failed_at[mine] = failed[0, real]
            batch.floor[mine], batch.ceiling[mine] = (record.floor.T[real], record.ceiling.T[real])
            for kept, found in zip(batch.statistics, (record.mean, record.least, record.greatest), strict=True):
                kept[mine] = found.T[real]
            return int(counts[0])

        numbers = [k for k, seats in enumerate(batch.seats) if live[seats].any()]
        if threads > 1 and len(numbers) > 1:
            return sum(workers(threads).map(advance, numbers))
        return sum(map(advance, numbers))

    def _march(
        self, batch: Batch, times: int, limit: int, threads: int, periodicity: Periodicity | None, numbers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """March at most `limit` cycles; `numbers` (n,) are those of the batch's samples in the whole run.

        Returns cycles spent and cycle error of each sample, (n,), and Newton solves. A sample that is periodic, has
        lost patience or has failed keeps what its last cycle left.
        """
        mixer = None
        if periodicity is not None and periodicity.accelerate:
            extrapolate = periodicity.extrapolate
            ahead = None if extrapolate is None else lambda who, start, end: extrapolate(numbers[who], start, end)
            mixer = Anderson(len(batch.state), batch.state.shape[1], ahead)
        n, samples = self.model.size, len(batch.state)
        program = self._fill(batch, times, steady=False)
        live = batch.failed_at == 0
        spent, error, solves = np.zeros(samples, int), np.full(samples, np.inf), 0
        mark, marked = np.full(samples, np.inf), np.zeros(samples, int)
        for cycle in range(limit):
            who = np.nonzero(live)[0]
            before = batch.state[who]
            solves += self._cycle(program, batch, live, times, times, threads)
            spent[who] += 1
            error[who], scale = drift(before[:, :n], batch.state[who, :n], batch.floor[who], batch.ceiling[who])
            live &= batch.failed_at == 0
            if periodicity is not None:
                live &= ~(error < periodicity.tolerance)
            if periodicity is not None and periodicity.patience is not None:
                halved = error < 0.5 * mark
                mark[halved], marked[halved] = error[halved], cycle
                live &= cycle - marked < periodicity.patience
            done = np.zeros(samples, bool)
            done[who] = ~live[who] | (cycle == limit - 1)
            batch.keep_waves(done)
            if not live.any():
                break
            batch.close_ranks(live)
            if mixer is not None and cycle < limit - 1:
                going = live[who]
                after = batch.state[who[going]]
                batch.state[who[going]] = mixer.propose(
                    who[going], before[going], after, scale[going], error[who[going]]
                )
        return spent, error, solves


def _status(failed_at: float, error: float, cycles: int, tolerance: float | None = None) -> str:
    if failed_at:
        return f"Newton's method did not converge at step {int(failed_at)} of a cycle"
    if tolerance is not None and not error < tolerance:
        return f"not periodic after {cycles} cycles: cycle error {error:.2g}, wanted {tolerance:g}"
    return OK
