"""A block of samples through whole cardiac cycles, until their quantities of interest repeat, and its checkpoints."""

import json
import time
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import replacing
from coronaryuq.flow3d.ensemble.quantities_of_interest import Observer
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.fem.time_step import Stepper
from coronaryuq.zerod.solver.coupled import CoupledNetwork

if TYPE_CHECKING:
    from coronaryuq.flow3d.ensemble.ensemble import Ensemble

_CHECK_EVERY = 20
_DIAGNOSE_EVERY = 10


@dataclass
class Outcome:
    """One sample's end: `values` of the quantities of interest (empty when failed), `reason` when failed.

    diagnostics: cycles, steps, change (of the last cycle, per `Settings.tolerance`), converged, cfl, mass balance,
    backflow. fields: nodal arrays for pictures, when they were asked for. waveforms: unknowns of the network over the
    last cycle, (steps + 1,) from the heart's beginning of it, when they were asked for; a checkpoint does not keep
    those of finished samples.
    """

    values: dict[str, float] = field(default_factory=dict)
    reason: str = ""
    diagnostics: dict[str, object] = field(default_factory=dict)
    cpu_s: float = 0.0
    wall_s: float = 0.0
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    waveforms: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        return not self.reason


class Block:
    """Up to LANES samples that advance together, from their periodic 0D states to their last cycle."""

    def __init__(
        self,
        ensemble: "Ensemble",
        changes,
        samples: int,
        refinement: int,
        checkpoint: Path | None,
        fields,
        report,
        label="",
        waveforms: Sequence[str] = (),
        start: np.ndarray | None = None,
    ):
        self.ensemble, self.samples, self.checkpoint, self.report = ensemble, samples, checkpoint, report
        settings = self.settings = ensemble.settings
        self.steps = settings.steps_per_cycle * 2**refinement
        lanes = np.minimum(np.arange(LANES), samples - 1)
        self.changes = {name: value[lanes] for name, value in changes.items()}
        self.space = ensemble.space(refinement)
        self.stepper = Stepper(
            self.space, settings.backflow_stabilisation, settings.momentum_tolerance, settings.momentum_sweeps
        )
        self.observer = Observer(ensemble.geometry, self.space, bool(fields))
        self.refinement, self.begun = refinement, time.perf_counter()
        self.label, self.waveforms = label, list(waveforms)
        self.begin = None if start is None else start[lanes]
        self.key = provenance.digest(
            {
                "settings": settings.model_dump(),
                "mesh": provenance.digest(ensemble.geometry.description),
                "network": provenance.digest(ensemble.network),
                "changes": {name: value.tolist() for name, value in self.changes.items()},
                "start": None if self.begin is None else provenance.digest(self.begin.tolist()),
                "refinement": refinement,
            }
        )

    def run(self) -> list[Outcome]:
        cpu, wall = time.process_time(), time.perf_counter()
        result = self.ensemble.engine.run(self.changes, periodic=True, tolerance=1e-5, start=self.begin)
        status = np.broadcast_to(result.status, (LANES,))
        self.reasons = ["" if one == "ok" else f"0D start: {one}" for one in status]
        self.zerod = CoupledNetwork(
            self.ensemble.case.network,
            self.ensemble.case.caps,
            self.space.admittance / self.density,
            self.changes,
            LANES,
            self.steps,
        )
        self._aortic_row = self.zerod.rows([self.ensemble.aorta])[0]
        self._recorded = self.zerod.rows([self.ensemble.case.renamed(name) for name in self.waveforms])
        self.waves = np.empty((len(self._recorded), self.steps, LANES))
        self.alive = np.array([not reason for reason in self.reasons])
        self.outcomes: list[Outcome | None] = [None] * LANES
        self.previous: dict[str, np.ndarray] | None = None
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
        cpu = (time.process_time() - cpu) / self.samples
        wall = (time.perf_counter() - wall) / self.samples
        for k in range(LANES):
            if self.outcomes[k] is None:
                self.outcomes[k] = Outcome(
                    reason=self.reasons[k], diagnostics=self._counts() | {"retry": self._started(k)}
                )
            self.outcomes[k].cpu_s, self.outcomes[k].wall_s = cpu, wall
        if self.checkpoint is not None:
            self._file().unlink(missing_ok=True)
        return self.outcomes[: self.samples]

    @property
    def density(self) -> float:
        return self.ensemble.density

    def _started(self, k: int) -> bool:
        return not self.reasons[k].startswith("0D start")

    def _unfinished(self) -> bool:
        return any(self.alive[k] and self.outcomes[k] is None for k in range(self.samples))

    def _start(self, result) -> None:
        names = self.ensemble.engine.state_names
        states = np.where(self.alive[:, None], result.state, 0.0)
        full = {name: states[:, k] for k, name in enumerate(names)}
        values = {}
        for unknown in self.zerod.model.variables:
            for name in (unknown, f"d_{unknown}"):
                values[name] = sum(weight * full[other] for weight, other in self.ensemble.case.source(name))
        self.zerod.start(values)
        self.zerod.failed[0, :LANES] = ~self.alive
        pressure, flow = self.zerod.cap_values()
        self.stepper.start(pressure, flow)

    def _advance(self, steps: int, observe: bool) -> None:
        stride = _stride(self.steps, self.settings.wall_samples_per_cycle)
        weight = stride * self.space.dt
        for step in range(1, steps + 1):
            self.stepper.step(self.zerod)
            self.total_steps += 1
            if observe:
                self.waves[:, self.zerod.position] = self.zerod.state[self._recorded, :LANES]
                self.observer.every_step(self.stepper, self.zerod.state[self._aortic_row, :LANES])
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
        """Find samples that blew up; take them out, so that the others go on."""
        with np.errstate(invalid="ignore"):
            speed = np.abs(self.stepper.u).max(axis=(0, 1))
            sound = speed < self.settings.speed_limit
        for k in np.flatnonzero(self.alive & ~(sound & (self.zerod.failed[0, :LANES] == 0))):
            time_ = self.total_steps / self.steps
            what = "0D side did not converge" if sound[k] else f"speed {speed[k]:.3g} cm/s"
            self.reasons[k] = f"blew up at {time_:.3f} cycles with {self.steps} steps per cycle: {what}"
            self.alive[k] = False
            self.zerod.failed[0, k] = 1.0
            self.stepper.drop(k)

    def _close_cycle(self) -> None:
        found = self.observer.quantities()
        change = np.full(LANES, np.inf)
        if self.previous is not None:
            change = _change(found, self.previous)
        self.previous = found
        last = self.cycle >= self.settings.max_cycles
        for k in range(LANES):
            if not self.alive[k] or self.outcomes[k] is not None:
                continue
            converged = self.cycle >= self.settings.min_cycles and change[k] <= self.settings.tolerance
            if converged or last:
                values = {name: float(value[k]) for name, value in found.items()} | self._cap_values(k)
                self.outcomes[k] = Outcome(
                    values=values,
                    diagnostics=self._counts()
                    | self._diagnostics(k)
                    | {"change": float(change[k]), "converged": bool(converged)},
                    fields=self._fields(k),
                    waveforms={n: np.append(w[:, k], w[0, k]) for n, w in zip(self.waveforms, self.waves, strict=True)},
                )

    def _counts(self) -> dict[str, object]:
        return {"cycles": self.cycle, "steps": self.total_steps, "steps_per_cycle": self.steps}

    def _diagnostics(self, k: int) -> dict[str, object]:
        o = self.observer
        return {
            "cfl": float(o.courant[k]),
            "mass_balance": float(o.imbalance[k]),
            "surface_flow_mismatch": float(o.surface_mismatch[k]),
            "backflow_steps": int(o.backflow_steps[k]),
            "momentum_sweeps_mean": float(o.sweeps[k] / o.steps),
            "momentum_unconverged_steps": int(o.unconverged_steps[k]),
        }

    def _cap_values(self, k: int) -> dict[str, float]:
        """Flows in the direction of blood and pressures at the caps, under the names of the 0D connections."""
        o, out = self.observer, {}
        for c, cap in enumerate(self.space.caps):
            place = self.ensemble.case.connection[cap.name]
            low, high = o.cap_flow_range[0][c, k], o.cap_flow_range[1][c, k]
            if cap.inlet:
                low, high = -high, -low
            mean = o.cap_flow[c, k] / o.steps
            out[f"mean_flow:{place}"] = float(-mean if cap.inlet else mean)
            out[f"min_flow:{place}"], out[f"max_flow:{place}"] = float(low), float(high)
            out[f"mean_pressure:{place}"] = float(o.cap_pressure[c, k] / o.steps)
        return out

    def _fields(self, k: int) -> dict[str, np.ndarray]:
        o = self.observer
        if not o.fields:
            return {}
        back = self.space.node_of
        fields = {}
        for name, value in (("mean_velocity", o.mean_velocity), ("mean_pressure", o.mean_pressure)):
            fields[name] = np.empty(value.shape[:-1])
            fields[name][back] = value[..., k] / o.wall.time
        nodes = back[o.wall.nodes]
        for name, value in (("TAWSS", o.wall.tawss()), ("OSI", o.wall.osi())):
            fields[name] = np.full(self.space.nodes, np.nan)
            fields[name][nodes] = value[:, k]
        fields["wall_faces"] = back[self.space.wall_faces]
        return fields

    def _file(self) -> Path:
        return self.checkpoint.with_name(f"{self.checkpoint.name}.npz")

    def _save(self) -> None:
        """Keep everything that the next cycle starts from."""
        if self.checkpoint is None:
            return
        arrays = {f"stepper_{name}": value for name, value in self.stepper.state().items()}
        arrays |= {f"previous_{name}": value for name, value in (self.previous or {}).items()}
        finished = [None if o is None else {"values": o.values, "diagnostics": o.diagnostics} for o in self.outcomes]
        with replacing(self._file()) as beside:
            np.savez(
                beside, key=self.key, zerod=self.zerod.state, zerod_failed=self.zerod.failed,
                position=self.zerod.position, alive=self.alive, reasons=json.dumps(self.reasons),
                cycle=self.cycle, total_steps=self.total_steps, finished=json.dumps(finished), **arrays,
            )  # fmt: skip

    def _resume(self) -> bool:
        if self.checkpoint is None or not self._file().is_file():
            return False
        try:
            with np.load(self._file()) as kept:
                if str(kept["key"]) != self.key:
                    return False
                self.stepper.restore({n.removeprefix("stepper_"): kept[n] for n in kept if n.startswith("stepper_")})
                previous = {n.removeprefix("previous_"): kept[n] for n in kept if n.startswith("previous_")}
                self.previous = previous or None
                self.zerod.state[:], self.zerod.failed[:] = kept["zerod"], kept["zerod_failed"]
                self.zerod.position = int(kept["position"])
                self.alive, self.reasons = kept["alive"], json.loads(str(kept["reasons"]))
                self.cycle, self.total_steps = int(kept["cycle"]), int(kept["total_steps"])
                self.outcomes = [None if o is None else Outcome(**o) for o in json.loads(str(kept["finished"]))]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return False
        return True


def _stride(steps: int, samples: int) -> int:
    """Largest divisor of `steps` that still gives at least `samples` readings a cycle, or 1."""
    return max(k for k in range(1, max(1, steps // samples) + 1) if steps % k == 0)


def _change(new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest change of a quantity of interest: FFR and OSI absolute, wall shear relative to its region's mean."""
    change = np.zeros(LANES)
    for name, value in new.items():
        if name.startswith(("ffr_", "osi_")):
            scale = 1.0
        elif name.startswith("tawss_"):
            scale = new[f"tawss_mean_{name.rsplit('_', 1)[1]}"]
        else:
            continue
        change = np.maximum(change, np.abs(value - old[name]) / scale)
    return change
