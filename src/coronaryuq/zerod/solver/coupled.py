"""A network with a 3D domain in it, one step at a time: monolithic coupling through the domain's condensed step.

Over one time step a 3D domain with caps is an affine multiport: flows out of it are Q = Q₀ − S (P − P_old), with S
(caps, caps) the same at every step, for all samples or each sample's own. That relation takes the place of the equation
of each FLOW block that stands for a cap, so Newton's loop of the 0D engine solves both sides together, with no
sub-iteration.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import Block
from coronaryuq.zerod.solver.assembly import Assembly, Context
from coronaryuq.zerod.solver.elements import ELEMENTS
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.kernel_tables import Record
from coronaryuq.zerod.solver.kernels import march
from coronaryuq.zerod.solver.lane_tables import fill
from coronaryuq.zerod.solver.lanes import LANES, table
from coronaryuq.zerod.solver.tables import make_program, write_elements

_CAP = "CapOf3D"
"""Kind of a FLOW block that stands for a cap."""


def _cap(block: Block, context: Context, system: Assembly) -> None:
    """Write q_i + σ_i Σ_j S_ij P_j = σ_i c_i, with q_i = σ_i Q_i; c_i changes from step to step."""
    row = block.equations[0]
    system.F(row, block.variables[1], 1.0)
    for other in context.model.blocks.values():
        if other.kind == _CAP:
            (weight,) = context.values(block, f"admittance:{other.name}")
            system.F(row, other.variables[0], weight)


class CoupledNetwork:
    """The 0D network coupled to a 3D domain, for up to LANES samples.

    network: svZeroDSolver JSON in which every cap is a FLOW block of `external_solver_coupling_blocks`; location
    `inlet` is an outlet of the 3D domain. caps: names of those blocks in the order of the domain's caps.
    admittance: S (caps, caps, 1 or samples), mL/s per dyn/cm2, for the time step period / steps_per_cycle.
    nominal: (caps, caps), that of the mesh if samples have their own.
    changes: "BLOCK.parameter" → (samples,) or scalar. start: (samples, ·) states by name, see `state_from`.
    Generalised-α as in the engine; the domain's relation holds at the end of each step.
    """

    def __init__(
        self,
        network: Network,
        caps: Sequence[str],
        admittance: np.ndarray,
        changes: Mapping[str, np.ndarray | float],
        samples: int,
        steps_per_cycle: int,
        nominal: np.ndarray | None = None,
        file: str | Path = "network",
    ):
        nominal = admittance[..., 0] if nominal is None else nominal
        network = network.deep_copy()
        simulation = network["simulation_parameters"]
        simulation["coupled_simulation"] = False
        simulation.setdefault("number_of_cardiac_cycles", 1)
        simulation.setdefault("number_of_time_pts_per_cardiac_cycle", steps_per_cycle + 1)
        engine = Engine(network, file)
        self.model, self.scheme, self.steps = (engine.model, engine.scheme, steps_per_cycle)
        if engine.coronaries:
            raise InputError(file, engine.coronaries[0].name, None, "open-loop coronaries cannot be coupled to 3D flow")
        known = engine.parameters
        for name in changes:
            if name not in known:
                raise InputError(file, name, None, "no such scalar parameter in the network")
        blocks = []
        for name in caps:
            block = self.model.blocks.get(name)
            if block is None or block.kind != "FLOW":
                raise InputError(file, f"external_solver_coupling_blocks.{name}", None, "no such FLOW block")
            block.kind = _CAP
            blocks.append(block)
        sign = np.array([1.0 if block.outlets else -1.0 for block in blocks])
        own = {}
        for i, block in enumerate(blocks):
            for j, other in enumerate(blocks):
                values = sign[i] * admittance[i, j]
                # The order of elimination follows these values, so that it must not depend on the samples.
                block.scalars[f"admittance:{other.name}"] = float(sign[i] * nominal[i, j])
                if values.size > 1:
                    own[f"{block.name}.admittance:{other.name}"] = values
        self._sign, self._admittance = sign[:, None], np.array(admittance)
        self._rows = np.array([block.equations[0] for block in blocks])
        self._pressure = np.array([block.variables[0] for block in blocks])
        self._flow = np.array([block.variables[1] for block in blocks])
        self.samples = samples
        phases = (np.arange(steps_per_cycle) + self.scheme.alpha_f) / steps_per_cycle
        zero = {name: np.ones(1) for name in changes if known[name] == 0.0}
        step = self.model.period / steps_per_cycle
        elements = {**ELEMENTS, _CAP: _cap}
        program = make_program(self.model, Context(self.model, zero, 1, phases), self.scheme, step, elements=elements)
        arrays = {name: np.asarray(value, float) for name, value in changes.items()} | own
        context = Context(self.model, arrays, samples, phases)
        if np.ptp(context.period) > 0:
            raise InputError(file, "cardiac_cycle_period", None, "coupled samples must share one period")
        group = fill(
            program,
            write_elements(self.model, context, elements),
            context.period,
            steps_per_cycle,
            self.scheme,
            slice(0, samples),
        )
        self._structure, self._work = program.structure, group.work
        shapes = group.values.shapes.reshape(-1, steps_per_cycle, LANES).transpose(1, 0, 2)
        self._shapes = np.ascontiguousarray(shapes)
        self._values = group.values._replace(shapes=table(self._shapes.shape[1]))
        self.state = table(2 * self.model.size)
        self.failed = table(1)
        waves = np.empty((0, 0, LANES))
        self._record = Record(np.empty(0, np.uint32), table(0), table(0), table(0), waves, table(0), table(0))
        self._counts = np.zeros(1, np.int64)
        self.position = 0

    def start(self, values: Mapping[str, np.ndarray], step: int = 0) -> None:
        """Set the state at step `step` of the cycle from unknowns by name, and their rates as `d_NAME`: (samples,)."""
        n = self.model.size
        for k, name in enumerate(self.model.variables):
            for row, key in ((k, name), (n + k, f"d_{name}")):
                self.state[row, : self.samples] = values[key]
                self.state[row, self.samples :] = self.state[row, 0]
        self.position = step % self.steps
        self.failed[:] = 0.0

    def cap_values(self) -> tuple[np.ndarray, np.ndarray]:
        """Return pressures (dyn/cm2) at the caps and flows out of the domain (mL/s): (caps, samples)."""
        pressure = self.state[self._pressure, : self.samples]
        return pressure, self._sign * self.state[self._flow, : self.samples]

    def rows(self, names: Sequence[str]) -> np.ndarray:
        """Return the row of `state` of each unknown, (k,)."""
        for name in names:
            if name not in self.model.index:
                raise InputError(self.model.file, name, None, "no such unknown in the coupled network")
        return np.array([self.model.index[name] for name in names], dtype=np.int64)

    def advance(self, flow: np.ndarray, admittance: np.ndarray, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Advance the network by one step with the domain's condensed step.

        Parameters
        ----------
        flow : array (caps, samples)
            Q₀: flows out of the domain (mL/s) at the end of the step if the cap pressures stayed at `pressure`.
        admittance : array (caps, caps, 1 or samples)
            S, mL/s per dyn/cm2; must be the one that this network was prepared for.
        pressure : array (caps, samples)
            P_old, dyn/cm2.

        Returns
        -------
        flow, pressure : array (caps, samples)
            Of the caps at the end of the step.
        """
        if not np.array_equal(admittance, self._admittance):
            raise ValueError("the domain's admittance is not the one that this network was prepared for")
        at_end = flow + _apply(admittance, pressure)
        old_pressure, old_flow = self.cap_values()
        at_start = old_flow + _apply(admittance, old_pressure)
        weight = self.scheme.alpha_f
        known = -self._sign * (weight * at_end + (1.0 - weight) * at_start)
        self._values.constant[self._rows, : self.samples] = known
        self._values.constant[self._rows, self.samples :] = known[:, :1]
        self._values.shapes[:] = self._shapes[self.position]
        march(
            *(self._structure, self._values, self._work, self.state, self.scheme, 1, 1),
            *(self.failed, self._record, self._counts),
        )
        self.position = (self.position + 1) % self.steps
        new_pressure, new_flow = self.cap_values()
        return new_flow, new_pressure


def _apply(matrix: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Compute matrix @ columns, one matrix (·, ·, 1) or each column's own, in one order of summation."""
    total = np.zeros_like(columns)
    for j in range(matrix.shape[1]):
        total += matrix[:, j] * columns[j]
    return total
