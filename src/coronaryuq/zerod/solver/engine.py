"""The 0D engine: many parameter sets of one network at once, with the numbers of svZeroDSolver."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network import output_names
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.solver.batch_runner import BatchRunner
from coronaryuq.zerod.solver.kernel_tables import Scheme
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import OK, Result

_REFINEMENTS = (1, 2, 4, 8)

_COARSENING, _FEWEST_COARSE_STEPS = 4, 100
"""Factor on the time step of the coarse approach to a periodic state, and the fewest such steps in a cycle."""
_COARSE_CYCLES = 8
_NEAR = 0.2
"""Cycle error below which a state is still related to the periodic state that it started from."""

Changes = Mapping[str, "np.ndarray | float"]


class Engine:
    """Solver of one network for many samples at once.

    The time scheme is generalised-α with the network's `rho_infty`; Newton's method stops at the network's
    `absolute_tolerance` in max|residual|. Both are those of svZeroDSolver.

    Parameters
    ----------
    network : Network
        As from `read_network`.
    file : str or Path
        Name for error messages.

    Raises
    ------
    InputError
        If the network is inconsistent or its equations are singular.
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
        self._runner = BatchRunner(self.model, self.scheme, self.steps_per_cycle)
        self.coronaries = self._runner.coronaries
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
            cycle, both ends included. All other parameters keep the network's values.
        quantities : sequence of str
            Statistics of the last cycle such as `mean_flow:A:B`, see `network.output_names`.
        waveforms : sequence of str
            Unknowns such as `flow:A:B` whose last cycle is kept.
        cycles : int, optional
            The network's number by default.
        steps_per_cycle : int, optional
            The network's number by default.
        start : array, (columns,) or (samples, columns), optional
            A `Result.state`; by default the network's own initial condition, steady if the network requests it. A
            closed loop keeps the blood volume that it starts with.
        threads : int
            Threads over groups of samples; results do not depend on it.

        Returns
        -------
        Result
            A sample that fails has a reason in `status`, and NaN.

        Raises
        ------
        InputError
            If a name does not exist in the network, or if a value has the wrong shape or is not finite.
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
            Criterion of periodicity, and the method of reaching it.
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
            starts = self._start_states(start, samples)
            start = self._coarse_approach(changes or {}, starts, steps, periodicity.tolerance, threads)
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
        parsed = [output_names.parse(name, self.model) for name in quantities]
        wave_unknowns = [output_names.unknown(name, self.model) for name in waveforms]
        recorded = np.unique(np.array([q.unknown for q in parsed] + wave_unknowns, dtype=np.int64))
        result = Result.blank(samples, steps, self.model.period, len(self.state_names), quantities, waveforms)
        starts = None if start is None else self._start_states(start, samples)
        tolerance = None if periodicity is None else periodicity.accepted
        remaining = np.arange(samples)
        for refinement in _REFINEMENTS:
            part = {name: value[remaining] if np.ndim(value) else value for name, value in values.items()}
            part_starts = None if starts is None else starts[remaining]
            batch = self._runner.begin(part, len(remaining), part_starts, threads)
            batch.allocate_records(recorded, steps * refinement, bool(wave_unknowns))
            spent, error, solves = self._runner.march(batch, steps * refinement, limit, threads, periodicity, remaining)
            statuses = [_status(*sample, tolerance) for sample in zip(batch.failed_at, error, spent, strict=True)]
            good = np.array([status == OK for status in statuses])
            statistics = dict(zip(output_names.STATISTICS, batch.statistics, strict=True))
            for name, quantity in zip(quantities, parsed, strict=True):
                column = statistics[quantity.statistic][:, np.searchsorted(recorded, quantity.unknown)]
                result.values[name][remaining] = np.where(good, column, np.nan)
            for name, unknown in zip(waveforms, wave_unknowns, strict=True):
                wave = batch.waves[np.searchsorted(recorded, unknown), :, ::refinement]
                result.waveforms[name][remaining] = np.where(good[:, None], wave, np.nan)
            result.state[remaining] = np.concatenate([batch.state, batch.offsets], axis=1)
            result.status[remaining], result.refinement[remaining] = statuses, refinement
            result.cycles[remaining], result.cycle_error[remaining] = spent, error
            result.solves += solves
            remaining = remaining[batch.failed_at > 0]
            if not remaining.size:
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
        batch = self._runner.begin({}, 1, None, 1)
        program = self._runner.fill(batch, steps, steady=False)
        while True:
            batch.allocate_records(np.arange(2 * n), steps, True)
            self._runner.advance(program, batch, np.ones(1, bool), steps, steps, 1)
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
                    raise InputError(self.model.file, name, value.shape, "expected a waveform per sample, (n, points)")
            elif name not in known:
                raise InputError(self.model.file, name, None, "no such scalar parameter in the network")
            elif value.ndim > 1:
                raise InputError(self.model.file, name, value.shape, "expected one number per sample, (n,)")
            if not np.all(np.isfinite(value)):
                raise InputError(self.model.file, name, "nan or inf", "expected finite numbers")
            values[name] = value
        return values, sizes.pop() if sizes else 1

    def _start_states(self, start: np.ndarray, samples: int) -> np.ndarray:
        start = np.atleast_2d(np.asarray(start, float))
        width = len(self.state_names)
        if start.shape[1] != width:
            raise InputError(
                self.model.file, "start", start.shape[1], f"expected {width} columns, a state of this network"
            )
        return np.broadcast_to(start, (samples, width))

    def _coarse_approach(
        self, changes: Changes, start: np.ndarray, steps: int, tolerance: float, threads: int
    ) -> np.ndarray:
        """Return initial states (n, columns of state): `start` plus the change that coarse steps predict.

        `start` is a periodic state of the network itself. Its counterpart is the periodic state on coarse steps; the
        change is that of the counterpart from the network's parameters to the sample's.
        """
        coarse = steps // _COARSENING
        if coarse < _FEWEST_COARSE_STEPS:
            return start
        key = start[0].tobytes(), steps, tolerance
        if key not in self._counterparts:
            first = self.run_cycles(cycles=1, steps_per_cycle=coarse, start=start[:1], threads=threads)
            last = first
            if first.ok[0] and first.cycle_error[0] < _NEAR:
                options = Periodicity(tolerance, cycles=_COARSE_CYCLES)
                last = self.run_to_periodic(
                    periodicity=options, steps_per_cycle=coarse, start=first.state, threads=threads
                )
            self._counterparts = {key: last.state if last.cycle_error[0] < 10.0 * tolerance else None}
        counterpart = self._counterparts[key]
        if counterpart is None:
            return start
        coarse_start = np.broadcast_to(counterpart, start.shape)
        changed = self.run_to_periodic(
            changes,
            periodicity=Periodicity(10.0 * tolerance, cycles=_COARSE_CYCLES),
            steps_per_cycle=coarse,
            start=coarse_start,
            threads=threads,
        )
        return np.where(changed.cycle_error[:, None] < _NEAR, start + (changed.state - coarse_start), start)


def _status(failed_at: float, error: float, cycles: int, tolerance: float | None = None) -> str:
    if failed_at:
        return f"Newton's method did not converge at step {int(failed_at)} of a cycle"
    if tolerance is not None and not error < tolerance:
        return f"not periodic after {cycles} cycles: cycle error {error:.2g}, expected {tolerance:g}"
    return OK
