"""Batches of one network: their initial states, the tables of their groups, and marching until they are periodic."""

from collections.abc import Mapping

import numpy as np

from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.solver.assembly import Context
from coronaryuq.zerod.solver.batch import Batch
from coronaryuq.zerod.solver.elements import coronary_offset
from coronaryuq.zerod.solver.kernel_tables import Scheme
from coronaryuq.zerod.solver.kernels import march
from coronaryuq.zerod.solver.lane_tables import fill
from coronaryuq.zerod.solver.lanes import LANES, table
from coronaryuq.zerod.solver.periodic import Anderson, Periodicity, drift
from coronaryuq.zerod.solver.tables import Program, make_program, write_elements
from coronaryuq.zerod.solver.threads import thread_pool

_GROUPS_WRITTEN = 8
"""Groups whose elements are written together: a term costs as much for one sample as for a hundred."""
_STEADY_STEPS, _STEADY_STEPS_PER_CYCLE = 31, 10


class BatchRunner:
    """Marches batches of one network, whose equations are analysed once for every set of parameters that may be zero.

    steps_per_cycle: the network's own number, for which pivots are chosen.
    """

    def __init__(self, model: Model, scheme: Scheme, steps_per_cycle: int):
        self.model, self.scheme, self.steps_per_cycle = model, scheme, steps_per_cycle
        self.coronaries = [b for b in model.blocks.values() if b.kind in ("CORONARY", "CORONARY_VAR_RES")]
        self._programs: dict[tuple, Program] = {}
        kinds = [name.partition(":")[0] for name in model.variables]
        self._kinds = np.unique(kinds, return_inverse=True)[1]

    def begin(self, parameters: dict, samples: int, start: np.ndarray | None, threads: int) -> Batch:
        """Return a batch in its initial state.

        start: (samples, columns of `Engine.state_names`); if None, the network's initial condition, made steady if the
        network requests it.
        """
        n = self.model.size
        offsets, state = (np.ones((samples, len(self.coronaries))), np.zeros((samples, 2 * n)))
        batch = Batch(parameters, offsets, state, np.zeros(samples))
        if start is not None:
            batch.state, batch.offsets = (start[:, : 2 * n].copy(), start[:, 2 * n :].copy())
            return batch
        batch.state[:] = self._initial_condition()
        steady = self.model.simulation.get("steady_initial", True)
        if steady:
            program = self.fill(batch, _STEADY_STEPS_PER_CYCLE, steady=True)
            batch.allocate_records(np.empty(0, np.int64), _STEADY_STEPS, False)
            self.advance(program, batch, np.ones(samples, bool), _STEADY_STEPS, _STEADY_STEPS_PER_CYCLE, threads)
        context = Context(self.model, parameters, samples, np.zeros(1))
        for k, block in enumerate(self.coronaries):
            batch.offsets[:, k] = coronary_offset(block, context, batch.state[:, :n], batch.state[:, n:], steady)
        return batch

    def fill(self, batch: Batch, times: int, steady: bool) -> Program:
        """Fill the tables of the batch's groups, each from its own samples only; `times` steps make a cycle."""
        samples = len(batch.state)
        program = self._program(batch.parameters, steady)
        batch.groups, batch.seats = [], []
        for first in range(0, samples, _GROUPS_WRITTEN * LANES):
            part = slice(first, min(first + _GROUPS_WRITTEN * LANES, samples))
            size = part.stop - part.start
            parameters = {k: v[part] if np.ndim(v) else v for k, v in batch.parameters.items()}
            offsets = {block.name: batch.offsets[part, k] for k, block in enumerate(self.coronaries)}
            context = Context(self.model, parameters, size, self._phases(times), steady, offsets)
            system = write_elements(self.model, context)
            for begin in range(0, size, LANES):
                seats = slice(begin, min(begin + LANES, size))
                batch.seats.append(np.arange(first + seats.start, first + seats.stop))
                batch.groups.append(fill(program, system, context.period, times, self.scheme, seats))
        return program

    def advance(self, program: Program, batch: Batch, live: np.ndarray, steps: int, times: int, threads: int) -> int:
        """March the samples of `live` (n,) through `steps` steps; return Newton solves, summed over groups."""
        size = self.model.size

        def advance_group(number: int) -> int:
            group, seats, record = batch.groups[number], batch.seats[number], batch.records[number]
            counted = np.arange(LANES) < len(seats)
            lanes = np.where(counted, np.resize(seats, LANES), seats[0])
            counted &= live[lanes]
            state, failed, counts = table(2 * size), table(1), np.zeros(1, np.int64)
            state[:] = batch.state[lanes].T
            failed[0] = np.where(live[lanes], batch.failed_at[lanes], 1.0)
            march(program.structure, group.values, group.work, state, self.scheme, steps, times, failed, record, counts)
            marched = lanes[counted]
            batch.state[marched] = state.T[counted]
            batch.failed_at[marched] = failed[0, counted]
            batch.floor[marched], batch.ceiling[marched] = (record.floor.T[counted], record.ceiling.T[counted])
            group_statistics = (record.mean, record.least, record.greatest)
            for of_batch, of_group in zip(batch.statistics, group_statistics, strict=True):
                of_batch[marched] = of_group.T[counted]
            return int(counts[0])

        numbers = [k for k, seats in enumerate(batch.seats) if live[seats].any()]
        if threads > 1 and len(numbers) > 1:
            return sum(thread_pool(threads).map(advance_group, numbers))
        return sum(map(advance_group, numbers))

    def march(
        self, batch: Batch, times: int, limit: int, threads: int, periodicity: Periodicity | None, numbers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """March at most `limit` cycles; `numbers` (n,) are those of the batch's samples in the whole run.

        Returns the number of cycles and the cycle error of each sample, (n,), and Newton solves. A sample that is
        periodic, has lost patience or has failed keeps the state and record of its last cycle.
        """
        mixer = None
        if periodicity is not None and periodicity.accelerate:
            extrapolate = periodicity.extrapolate
            ahead = None if extrapolate is None else lambda who, start, end: extrapolate(numbers[who], start, end)
            mixer = Anderson(len(batch.state), batch.state.shape[1], ahead)
        n, samples = self.model.size, len(batch.state)
        program = self.fill(batch, times, steady=False)
        live = batch.failed_at == 0
        spent, error, solves = np.zeros(samples, int), np.full(samples, np.inf), 0
        last_halved_error, last_halved_cycle = np.full(samples, np.inf), np.zeros(samples, int)
        for cycle in range(limit):
            marched = np.nonzero(live)[0]
            before = batch.state[marched]
            solves += self.advance(program, batch, live, times, times, threads)
            spent[marched] += 1
            error[marched], scale = drift(
                before[:, :n], batch.state[marched, :n], batch.floor[marched], batch.ceiling[marched], self._kinds
            )
            live &= batch.failed_at == 0
            if periodicity is not None:
                halved = error < 0.5 * last_halved_error
                last_halved_error[halved], last_halved_cycle[halved] = error[halved], cycle
                live &= ~periodicity.over(error, cycle - last_halved_cycle)
            done = np.zeros(samples, bool)
            done[marched] = ~live[marched] | (cycle == limit - 1)
            batch.keep_waves(done)
            if not live.any():
                break
            batch.close_ranks(live)
            if mixer is not None and cycle < limit - 1:
                going = live[marched]
                after = batch.state[marched[going]]
                batch.state[marched[going]] = mixer.propose(
                    marched[going], before[going], after, scale[going], error[marched[going]]
                )
        return spent, error, solves

    def _initial_condition(self) -> np.ndarray:
        n, state = self.model.size, np.zeros(2 * self.model.size)
        initial = self.model.network.get("initial_condition", {})
        for k, name in enumerate(self.model.variables):
            default = 0.0
            if name.startswith(("pressure:", "P_c:")):
                default = initial.get("pressure_all", 0.0)
            elif name.startswith("flow:"):
                default = initial.get("flow_all", 0.0)
            state[k] = initial.get(name, default)
            state[n + k] = self.model.network.get("initial_condition_d", {}).get(name, 0.0)
        return state

    def _program(self, changed: Mapping, steady: bool) -> Program:
        nominal = self.model.parameters
        zero = frozenset(name for name in changed if nominal.get(name) == 0.0)
        key = zero, steady
        if key not in self._programs:
            # Pivots are chosen at the network's own steps, so that no run depends on what ran before it.
            times = _STEADY_STEPS_PER_CYCLE if steady else self.steps_per_cycle
            nonzero, own = (
                Context(self.model, dict.fromkeys(names, np.ones(1)), 1, self._phases(times), steady)
                for names in (zero, ())
            )
            self._programs[key] = make_program(self.model, nonzero, self.scheme, self.model.period / times, own)
        return self._programs[key]

    def _phases(self, times: int) -> np.ndarray:
        return (np.arange(times) + self.scheme.alpha_f) / times
