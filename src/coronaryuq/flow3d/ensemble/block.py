"""A block of samples through whole cardiac cycles, until their quantities of interest repeat, and its checkpoints."""

import json
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import replacing
from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.ensemble.observer import Observer
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.fem.time_step import Stepper
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.shapes import Shapes
from coronaryuq.zerod.solver.coupled import CoupledNetwork
from coronaryuq.zerod.solver.periodic import Periodicity

_CHECK_EVERY = 20
_DIAGNOSE_EVERY = 10


@dataclass
class Outcome:
    """How one sample ended.

    Parameters
    ----------
    values
        Quantities of interest; empty if it failed.
    reason
        One line if it failed.
    diagnostics
        Cycles, steps, change (of the last cycle, see `Settings.tolerance`), converged, quantities of the earlier
        cycles, CFL, mass balance, backflow.
    cpu_s, wall_s
        Its fraction of the block's time, s.
    retry
        Whether a failed sample may succeed with smaller steps.
    earlier_failures
        Reasons of failed runs with longer steps.
    fields
        Nodal arrays for pictures, if asked for.
    waveforms
        Unknowns of the network over the last cycle, (steps + 1,) from the beginning of the heart's cycle, if asked
        for; a checkpoint does not keep those of finished samples.
    """

    values: dict[str, float] = field(default_factory=dict)
    reason: str = ""
    diagnostics: dict[str, Any] = field(default_factory=dict)
    cpu_s: float = 0.0
    wall_s: float = 0.0
    retry: bool = False
    earlier_failures: list[str] = field(default_factory=list)
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    waveforms: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Task:
    """What a block is to run; see `Ensemble.run`. checkpoint: the file itself; refinement: doublings of the steps."""

    changes: Mapping[str, np.ndarray]
    samples: int
    refinement: int = 0
    checkpoint: Path | None = None
    fields: bool = False
    label: str = ""
    waveforms: Sequence[str] = ()
    start: np.ndarray | None = None
    shapes: Shapes | None = None


class Block:
    """Up to LANES samples that advance together, from their periodic 0D states to their last cycle."""

    def __init__(
        self, model: FlowModel, settings: Settings, space: Discretisation, task: Task, report: "Report | None" = None
    ):
        self.model, self.settings, self.space, self.report = model, settings, space, report
        self.samples, self.label, self.checkpoint = task.samples, task.label, task.checkpoint
        self.steps = settings.steps_per_cycle * 2**task.refinement
        lanes = np.minimum(np.arange(LANES), task.samples - 1)
        self.changes = {name: value[lanes] for name, value in task.changes.items()}
        self.first_state = None if task.start is None else task.start[lanes]
        self.shapes = None if task.shapes is None else task.shapes.of(lanes.tolist())
        self.stepper = Stepper(
            space, settings.backflow_stabilisation, settings.momentum_tolerance, settings.momentum_sweeps
        )
        self.observer = Observer(model.domain, space, task.fields, settings.low_shear, model.ffr_places)
        self.waveforms = list(task.waveforms)
        self.begun = time.perf_counter()
        self.key = provenance.digest(
            {
                "settings": settings.model_dump(),
                "mesh": provenance.digest(model.domain.description.content()),
                "network": provenance.digest(model.network),
                "changes": {name: value.tolist() for name, value in self.changes.items()},
                "start": None if self.first_state is None else provenance.digest(self.first_state.tolist()),
                "refinement": task.refinement,
            }
            | self._own()
        )

    def run(self) -> list[Outcome]:
        cpu, wall = time.process_time(), time.perf_counter()
        loop = self.changes if self.shapes is None else self.shapes.start(self.changes, self.model.network)
        result = self.model.engine.run_to_periodic(
            loop, periodicity=Periodicity(tolerance=1e-5), start=self.first_state
        )
        status = np.broadcast_to(result.status, (LANES,))
        self.reasons = ["" if lane == "ok" else f"0D start: {lane}" for lane in status]
        coupled = self.model.coupled
        self.zerod = CoupledNetwork(
            coupled.network, coupled.caps, self.space.admittance / self.model.density, self._cut_changes(),
            LANES, self.steps, self.space.nominal_admittance / self.model.density,
        )  # fmt: skip
        self._aortic_row = self.zerod.rows([self.model.aortic_pressure])[0]
        self._end_rows = self.zerod.rows(self.observer.ends)
        self._recorded = self.zerod.rows([coupled.in_cut_network(name) for name in self.waveforms])
        self.waves = np.empty((len(self._recorded), self.steps, LANES))
        self.alive = np.array([not reason for reason in self.reasons])
        self.outcomes: list[Outcome | None] = [None] * LANES
        self.earlier: dict[str, np.ndarray] = {}
        self.cycle, self.total_steps = 0, 0
        if not self._resume():
            self._start(result)
            self._advance(int(round(self.settings.ramp_cycles * self.steps)), observe=False)
            self._save()
        while self.cycle < self.settings.max_cycles and self._unfinished():
            self.observer.reset()
            self._advance(self.steps, observe=True)
            self.cycle += 1
            self._close_cycle()
            self._save()
        outcomes = [outcome or self._failure(k) for k, outcome in enumerate(self.outcomes[: self.samples])]
        cpu = (time.process_time() - cpu) / self.samples
        wall = (time.perf_counter() - wall) / self.samples
        for outcome in outcomes:
            outcome.cpu_s, outcome.wall_s = cpu, wall
        if self.checkpoint is not None:
            self.checkpoint.unlink(missing_ok=True)
        return outcomes

    def _own(self) -> dict[str, Any]:
        """Return what of the samples' lumens and blood a checkpoint must agree with."""
        if self.shapes is None:
            return {}
        points = sha256(self.shapes.points.tobytes()).hexdigest()
        return {"points": points, "viscosity": self.shapes.viscosity.tolist()}

    def _cut_changes(self) -> dict[str, np.ndarray]:
        """Return the changes of the network outside 3D."""
        coupled = self.model.coupled
        changes = coupled.changes(self.changes)
        return changes if self.shapes is None else self.shapes.beside(changes, coupled.network)

    def _failure(self, k: int) -> Outcome:
        # Without a periodic 0D state smaller steps are no help.
        retry = not self.reasons[k].startswith("0D start")
        return Outcome(reason=self.reasons[k], diagnostics=self._counts(), retry=retry)

    def _unfinished(self) -> bool:
        return any(self.alive[k] and self.outcomes[k] is None for k in range(self.samples))

    def _start(self, result) -> None:
        states = np.where(self.alive[:, None], result.state, 0.0)
        full = {name: states[:, k] for k, name in enumerate(self.model.engine.state_names)}
        values = {}
        for unknown in self.zerod.model.variables:
            for name in (unknown, f"d_{unknown}"):
                values[name] = sum(
                    (weight * full[other] for weight, other in self.model.coupled.in_full_network(name)),
                    np.zeros(LANES),
                )
        self.zerod.start(values)
        self.zerod.failed[0, :LANES] = ~self.alive
        pressure, flow = self.zerod.cap_values()
        self.stepper.start(pressure, flow)

    def _advance(self, steps: int, observe: bool) -> None:
        stride = stride_of(self.steps, self.settings.wall_samples_per_cycle)
        weight = stride * self.space.dt
        for step in range(1, steps + 1):
            self.stepper.step(self.zerod)
            self.total_steps += 1
            if observe:
                self.waves[:, self.zerod.position] = self.zerod.state[self._recorded, :LANES]
                aortic, at_ends = (self.zerod.state[rows, :LANES] for rows in (self._aortic_row, self._end_rows))
                self.observer.every_step(self.stepper, aortic, at_ends)
                if step % stride == 0:
                    self.observer.at_wall_sample(self.stepper, weight)
                    if step % (stride * _DIAGNOSE_EVERY) == 0:
                        self.observer.diagnose(self.stepper)
            if step % _CHECK_EVERY == 0 or step == steps:
                self._check()
                if self.report is not None:
                    self.report(self, step / steps)
                if not self.alive[: self.samples].any():
                    return

    def _check(self) -> None:
        """Find samples that blew up and stop them, so that the others go on."""
        with np.errstate(invalid="ignore"):
            speed = np.abs(self.stepper.u).max(axis=(0, 1))
            within_limit = speed < self.settings.speed_limit
        for k in np.flatnonzero(self.alive & ~(within_limit & (self.zerod.failed[0, :LANES] == 0))).tolist():
            cycles = self.total_steps / self.steps
            what = "0D side did not converge" if within_limit[k] else f"speed {speed[k]:.3g} cm/s"
            self.reasons[k] = f"diverged at {cycles:.3f} cycles with {self.steps} steps per cycle: {what}"
            self.alive[k] = False
            self.zerod.failed[0, k] = 1.0
            self.stepper.drop(k)

    def _close_cycle(self) -> None:
        quantities = self.observer.quantities()
        earlier = self.earlier
        change = _change(quantities, {n: v[-1] for n, v in earlier.items()}) if earlier else np.full(LANES, np.inf)
        self.earlier = {name: np.array([*earlier.get(name, ()), value]) for name, value in quantities.items()}
        last = self.cycle >= self.settings.max_cycles
        for k in range(LANES):
            if not self.alive[k] or self.outcomes[k] is not None:
                continue
            converged = self.cycle >= self.settings.min_cycles and change[k] <= self.settings.tolerance
            if converged or last:
                self.outcomes[k] = Outcome(
                    values={name: float(value[k]) for name, value in quantities.items()} | self._cap_values(k),
                    diagnostics=self._counts()
                    | self.observer.diagnostics(k)
                    | {"change": float(change[k]), "converged": bool(converged)}
                    | {"earlier_cycles": {name: value[:, k].tolist() for name, value in earlier.items()}},
                    fields=self.observer.fields_of(k),
                    waveforms={n: np.append(w[:, k], w[0, k]) for n, w in zip(self.waveforms, self.waves, strict=True)},
                )

    def _counts(self) -> dict[str, Any]:
        return {"cycles": self.cycle, "steps": self.total_steps, "steps_per_cycle": self.steps}

    def _cap_values(self, k: int) -> dict[str, float]:
        """Return flows in the direction of blood and pressures at the caps, by 0D connection."""
        o, out = self.observer, {}
        for c, cap in enumerate(self.space.caps):
            place = self.model.coupled.connection[cap.name]
            low, high = o.cap_flow_range[0][c, k], o.cap_flow_range[1][c, k]
            if cap.inlet:
                low, high = -high, -low
            mean = o.cap_flow[c, k] / o.steps
            out[f"mean_flow:{place}"] = float(-mean if cap.inlet else mean)
            out[f"min_flow:{place}"], out[f"max_flow:{place}"] = float(low), float(high)
            out[f"mean_pressure:{place}"] = float(o.cap_pressure[c, k] / o.steps)
        return out

    def _save(self) -> None:
        """Keep everything that the next cycle starts from."""
        if self.checkpoint is None:
            return
        arrays: dict[str, Any] = {f"stepper_{name}": value for name, value in self.stepper.state().items()}
        arrays |= {f"earlier_{name}": value for name, value in self.earlier.items()}
        finished = [None if o is None else {"values": o.values, "diagnostics": o.diagnostics} for o in self.outcomes]
        with replacing(self.checkpoint) as beside:
            np.savez(
                beside, key=self.key, zerod=self.zerod.state, zerod_failed=self.zerod.failed,
                position=self.zerod.position, alive=self.alive, reasons=json.dumps(self.reasons),
                cycle=self.cycle, total_steps=self.total_steps, finished=json.dumps(finished), **arrays,
            )  # fmt: skip

    def _resume(self) -> bool:
        if self.checkpoint is None or not self.checkpoint.is_file():
            return False
        try:
            with np.load(self.checkpoint) as kept:
                if str(kept["key"]) != self.key:
                    return False
                self.stepper.restore({n.removeprefix("stepper_"): kept[n] for n in kept if n.startswith("stepper_")})
                self.earlier = {n.removeprefix("earlier_"): kept[n] for n in kept if n.startswith("earlier_")}
                self.zerod.state[:], self.zerod.failed[:] = kept["zerod"], kept["zerod_failed"]
                self.zerod.position = int(kept["position"])
                self.alive, self.reasons = kept["alive"], json.loads(str(kept["reasons"]))
                self.cycle, self.total_steps = int(kept["cycle"]), int(kept["total_steps"])
                self.outcomes = [None if o is None else Outcome(**o) for o in json.loads(str(kept["finished"]))]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return False
        return True


Report = Callable[[Block, float], None]


def stride_of(steps: int, samples: int) -> int:
    """Return the largest divisor of `steps` that still gives at least `samples` readings a cycle, or 1."""
    return max(k for k in range(1, max(1, steps // samples) + 1) if steps % k == 0)


def _change(new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the largest change of a quantity: FFR and OSI absolute, wall shear relative to its region's mean.

    Averages over patches are not asked: they change less than the extremes.
    """
    change = np.zeros(LANES)
    for name, value in new.items():
        if "_patch_" in name:
            continue
        if name.startswith(("ffr_", "osi_")):
            change = np.maximum(change, np.abs(value - old[name]))
        elif name.startswith("tawss_"):
            scale = new[f"tawss_mean_{name.rsplit('_', 1)[1]}"]
            change = np.maximum(change, np.abs(value - old[name]) / scale)
    return change
