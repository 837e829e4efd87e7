"""The 0D engine: many parameter sets of one network at once, with the numbers of svZeroDSolver."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from coronaryuq.errors import InputError
from coronaryuq.zerod import quantities as named
from coronaryuq.zerod.assembly import Context
from coronaryuq.zerod.elements import coronary_offset
from coronaryuq.zerod.kernels import Scheme, march
from coronaryuq.zerod.lanes import LANES, table
from coronaryuq.zerod.model import Model
from coronaryuq.zerod.network import Network
from coronaryuq.zerod.program import Group, Program, fill, make_program, write_elements

OK = "ok"
_STEADY_STEPS, _STEADY_STEPS_PER_CYCLE = 31, 10
_REFINEMENTS = (1, 2, 4, 8)
_MAX_CYCLES = 100

Changes = Mapping[str, "np.ndarray | float"]


@dataclass
class Result:
    """What a batch of n samples gave.

    values: quantity → (n,), over the last cycle; NaN where a sample failed. waveforms: name → (n, steps + 1) over
    `time` (steps + 1,), the last cycle. status: (n,) of `ok` or a reason. state: (n, unknowns) at the end of the last
    cycle, that is at the start of the next, usable as `start=`. cycles: (n,) spent. cycle_error: (n,) see `Engine.run`.
    refinement: (n,) how many times smaller than asked a sample's steps had to be. solves: Newton solves in all, of
    groups of `LANES` samples.
    """

    values: dict[str, np.ndarray]
    waveforms: dict[str, np.ndarray]
    time: np.ndarray
    status: np.ndarray
    state: np.ndarray
    cycles: np.ndarray
    cycle_error: np.ndarray
    refinement: np.ndarray
    solves: int = 0

    @property
    def ok(self) -> np.ndarray:
        return self.status == OK

    @classmethod
    def blank(cls, samples: int, steps: int, period: float, width: int, quantities, waveforms) -> "Result":
        """A result to be filled in: NaN values, no status."""
        return cls(
            values={name: np.full(samples, np.nan) for name in quantities},
            waveforms={name: np.full((samples, steps + 1), np.nan) for name in waveforms},
            time=period * np.arange(steps + 1) / steps,
            status=np.full(samples, "", dtype=object),
            state=np.full((samples, width), np.nan),
            cycles=np.zeros(samples, int),
            cycle_error=np.full(samples, np.inf),
            refinement=np.ones(samples, int),
        )


@dataclass
class _Batch:
    """Samples that march together: their tables, their state y, ẏ (n, 2 unknowns) and what the last cycle left."""

    parameters: dict[str, np.ndarray]
    offsets: np.ndarray
    state: np.ndarray
    groups: list[Group] = field(default_factory=list)
    failed_at: np.ndarray = None
    statistics: tuple[np.ndarray, ...] = ()
    waves: np.ndarray | None = None


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
            raise InputError(
                file, "simulation_parameters.coupled_simulation", True, "is driven by a 3D solver; set false"
            )
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

    @property
    def unknowns(self) -> list[str]:
        """Names of the unknowns, svZeroDSolver's, in its order."""
        return self.model.variables

    @property
    def parameters(self) -> dict[str, float]:
        """Every scalar that `changes` may name, with the network's own value."""
        return self.model.parameters

    @property
    def state_names(self) -> list[str]:
        """Columns of `Result.state`: unknowns, their rates, and the reference pressure of each open-loop coronary."""
        rates = [f"d_{name}" for name in self.model.variables]
        return [*self.model.variables, *rates, *(f"offset:{block.name}" for block in self.coronaries)]

    def run(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        periodic: bool = False,
        cycles: int | None = None,
        steps_per_cycle: int | None = None,
        tolerance: float = 1e-4,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result:
        """Run a batch and measure its last cycle.

        changes: "BLOCK.parameter" → (n,) or scalar; what it does not name keeps the network's value.
        quantities, waveforms: see `zerod.quantities`. periodic: march until the cycle error is below `tolerance`,
        at most `cycles` (default 100) of them; otherwise march exactly `cycles` (default: the network's).
        start: (unknowns,) or (n, unknowns), a `Result.state`; by default the network's own initial condition, steady
        if it says so. threads: over groups of samples; results do not depend on it.

        cycle error: the largest relative change from one cycle to the next of mean flow and mean pressure at the
        network's caps (svZeroDSolver's cycle-to-cycle error), and of every unknown's value at the cycle's start,
        relative to that unknown's range over the cycle.
        """
        values, samples = self._parameters(changes or {}, start)
        steps = self.steps_per_cycle if steps_per_cycle is None else int(steps_per_cycle)
        wanted = [named.parse(name, self.model) for name in quantities]
        shown = [named.unknown(name, self.model) for name in waveforms]
        result = Result.blank(samples, steps, self.model.period, len(self.state_names), quantities, waveforms)
        left = np.arange(samples)
        for refinement in _REFINEMENTS:
            part = {name: value[left] if np.ndim(value) else value for name, value in values.items()}
            begin = (
                None
                if start is None
                else np.broadcast_to(np.asarray(start, float), (samples, result.state.shape[1]))[left]
            )
            batch = self._begin(part, len(left), begin, threads)
            outcome = self._march(batch, periodic, cycles, steps * refinement, tolerance, shown, threads)
            spent, error, reasons, solves = outcome
            result.solves += solves
            self._collect(result, batch, left, spent, error, reasons, refinement, wanted, quantities, waveforms, steps)
            left = left[[reason != OK for reason in reasons]]
            if not left.size:
                break
        return result

    def histories(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The network's own sample, cycle after cycle without end: y and ẏ at every step, (steps + 1, unknowns) each.

        Raises `RuntimeError` when Newton's method does not converge.
        """
        n, steps = self.model.size, self.steps_per_cycle
        batch = self._begin({}, 1, None, 1)
        program = self._fill(batch, steps, steady=False)
        while True:
            self._cycle(program, batch, steps, steps, np.arange(2 * n), True, 1)
            if batch.failed_at[0]:
                raise RuntimeError(_not_converged(batch.failed_at[0], steps))
            yield batch.waves[:, 0, :n], batch.waves[:, 0, n:]

    def _parameters(self, changes: Changes, start) -> tuple[dict[str, np.ndarray], int]:
        known = self.parameters
        sizes = {np.shape(value)[0] for value in changes.values() if np.ndim(value)}
        if start is not None and np.ndim(start) == 2:
            sizes.add(np.shape(start)[0])
        if len(sizes) > 1:
            raise InputError(self.model.file, "changes", sorted(sizes), "all arrays must have one length, the samples")
        values = {}
        for name, value in changes.items():
            if name not in known:
                raise InputError(self.model.file, name, None, "no such scalar parameter in the network")
            value = np.asarray(value, float)
            if not np.all(np.isfinite(value)):
                raise InputError(self.model.file, name, "nan or inf", "want finite numbers")
            values[name] = value
        return values, sizes.pop() if sizes else 1

    def _program(self, changed: Mapping, times: int, steady: bool) -> Program:
        nominal = self.parameters
        zero = frozenset(name for name in changed if nominal[name] == 0.0)
        key = zero, steady
        if key not in self._programs:
            at = Context(self.model, dict.fromkeys(zero, np.ones(1)), 1, self._phases(times), steady)
            self._programs[key] = make_program(self.model, at, self.scheme, self.model.period / times)
        return self._programs[key]

    def _phases(self, times: int) -> np.ndarray:
        return (np.arange(times) + self.scheme.alpha_f) / times

    def _fill(self, batch: _Batch, times: int, steady: bool) -> Program:
        samples = len(batch.state)
        program = self._program(batch.parameters, times, steady)
        batch.groups = []
        for first in range(0, samples, LANES):
            part = slice(first, min(first + LANES, samples))
            size = part.stop - part.start
            parameters = {k: v[part] if np.ndim(v) else v for k, v in batch.parameters.items()}
            offsets = {block.name: batch.offsets[part, k] for k, block in enumerate(self.coronaries)}
            at = Context(self.model, parameters, size, self._phases(times), steady, offsets)
            system = write_elements(self.model, at)
            batch.groups.append(fill(program, system, at.period, times, self.scheme, slice(0, size)))
        return program

    def _begin(self, parameters: dict, samples: int, start: np.ndarray | None, threads: int) -> _Batch:
        n = self.model.size
        batch = _Batch(parameters, np.ones((samples, len(self.coronaries))), np.zeros((samples, 2 * n)))
        batch.failed_at = np.zeros(samples)
        if start is not None:
            if start.shape[1] != len(self.state_names):
                raise InputError(self.model.file, "start", start.shape[1], f"want {len(self.state_names)} columns")
            batch.state, batch.offsets = start[:, : 2 * n].copy(), start[:, 2 * n :].copy()
            return batch
        batch.state[:] = self._initial_condition()
        steady = self.model.simulation.get("steady_initial", True)
        if steady:
            program = self._fill(batch, _STEADY_STEPS_PER_CYCLE, steady=True)
            self._cycle(program, batch, _STEADY_STEPS, _STEADY_STEPS_PER_CYCLE, np.empty(0, np.int64), False, threads)
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

    def _cycle(
        self, program: Program, batch: _Batch, steps: int, times: int, recorded, waves: bool, threads: int
    ) -> int:
        """March all groups; failed samples keep still. Returns the Newton solves of groups."""
        samples = len(batch.state)
        statistics = [np.empty((samples, len(recorded))) for _ in range(3)]
        shown = np.empty((steps + 1 if waves else 0, samples, len(recorded)))

        def advance(number: int) -> int:
            group, first = batch.groups[number], number * LANES
            lanes = np.arange(first, first + LANES)
            real = lanes < samples
            lanes = np.where(real, lanes, first)
            state, failed = table(2 * self.model.size), table(1)
            state[:] = batch.state[lanes].T
            failed[0] = batch.failed_at[lanes]
            tables = [table(max(len(recorded), 1)) for _ in range(3)]
            waves_here = np.empty((steps + 1 if waves else 0, len(recorded), LANES))
            counts = np.zeros(1, np.int64)
            march(
                *(program.structure, group.values, group.work, state, self.scheme, steps, times),
                *(failed, recorded, *tables, waves_here, counts),
            )
            mine = lanes[real]
            batch.state[mine] = state.T[real]
            batch.failed_at[mine] = failed[0, real]
            for kept, found in zip(statistics, tables, strict=True):
                kept[mine] = found[: len(recorded)].T[real]
            if waves:
                shown[:, mine] = waves_here.transpose(0, 2, 1)[:, real]
            return int(counts[0])

        if threads > 1 and len(batch.groups) > 1:
            with ThreadPoolExecutor(threads) as pool:
                solves = sum(pool.map(advance, range(len(batch.groups))))
        else:
            solves = sum(map(advance, range(len(batch.groups))))
        batch.statistics, batch.waves = tuple(statistics), shown
        return solves

    def _march(self, batch, periodic, cycles, times, tolerance, shown, threads):
        n, samples = self.model.size, len(batch.state)
        recorded = np.arange(n, dtype=np.int64)
        program = self._fill(batch, times, steady=False)
        limit = cycles or (_MAX_CYCLES if periodic else self.cycles)
        spent, error = np.zeros(samples, int), np.full(samples, np.inf)
        solves = 0
        means = None
        for cycle in range(limit):
            before = batch.state.copy()
            last = cycle == limit - 1
            solves += self._cycle(program, batch, times, times, recorded, bool(shown) and (last or periodic), threads)
            spent += 1
            error = self._cycle_error(before, batch, means)
            means = batch.statistics[0]
            if periodic and np.all((error < tolerance) | (batch.failed_at > 0)):
                break
        reasons = [_not_converged(at, times) if at else OK for at in batch.failed_at]
        if periodic:
            for k in range(samples):
                if reasons[k] == OK and not error[k] < tolerance:
                    reasons[k] = f"not periodic after {spent[k]} cycles (cycle error {error[k]:.2g})"
        return spent, error, reasons, solves

    def _cycle_error(self, before: np.ndarray, batch: _Batch, means: np.ndarray | None) -> np.ndarray:
        n = self.model.size
        new, low, high = batch.statistics
        span = high - low
        scale = np.maximum(span, 1e-6 * np.maximum(np.abs(low), np.abs(high)))
        change = np.abs(batch.state[:, :n] - before[:, :n])
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.where(scale > 0, change / scale, 0.0).max(axis=1)
            if means is not None:
                caps = [unknown for cap in self.model.caps for unknown in cap]
                drift = np.abs(new[:, caps] - means[:, caps]) / np.abs(means[:, caps])
                error = np.maximum(error, np.nan_to_num(drift, nan=0.0).max(axis=1, initial=0.0))
        return error

    def _collect(self, result, batch, left, spent, error, reasons, refinement, wanted, quantities, waveforms, steps):
        good = np.array([reason == OK for reason in reasons])
        statistics = dict(zip(("mean", "min", "max"), batch.statistics, strict=True))
        for name, quantity in zip(quantities, wanted, strict=True):
            found = statistics[quantity.statistic][:, quantity.unknown]
            result.values[name][left] = np.where(good, found, np.nan)
        for name in waveforms:
            wave = batch.waves[::refinement, :, named.unknown(name, self.model)].T
            result.waveforms[name][left] = np.where(good[:, None], wave, np.nan)
        result.state[left] = np.concatenate([batch.state, batch.offsets], axis=1)
        result.status[left], result.cycles[left] = reasons, spent
        result.cycle_error[left], result.refinement[left] = error, refinement


def _not_converged(step: float, steps: int) -> str:
    return f"Newton's method did not converge at step {int(step)} of {steps} of a cycle"
