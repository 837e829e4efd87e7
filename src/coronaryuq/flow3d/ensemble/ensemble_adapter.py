"""The ensemble solver behind the interface of the 3D codes: MPI ranks share a batch, each sample gets a record."""

import sys
import time
from collections.abc import Sequence

import numpy as np

from coronaryuq.core import provenance, records
from coronaryuq.core.ranks import Ranks
from coronaryuq.core.records import Record
from coronaryuq.flow3d.adapter import FlowModel, Outputs, Sample
from coronaryuq.flow3d.ensemble.block import Block, Outcome
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.ensemble.fields import write_fields
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.settings import Settings
from coronaryuq.zerod.theta import theta_changes

COUPLING = "closed loop, monolithic at every step"


class EnsembleAdapter:
    """Blocks of LANES samples, dealt to the MPI ranks in turn; the numbers are the same for any number of ranks.

    A sample that blows up is run again with smaller steps, then recorded as failed.
    """

    def __init__(self, model: FlowModel, settings: Settings, ranks: Ranks):
        self.model, self.settings, self.ranks = model, settings, ranks

    def run(self, samples: Sequence[Sample], outputs: Outputs) -> None:
        rows: dict[int, Record] = {}
        for share in self.ranks.gather(lambda: self._run_share(samples, outputs)):
            rows |= share
        if self.ranks.rank == 0:
            records.write(outputs.records, [rows[k] for k in range(len(samples))])

    def _run_share(self, samples: Sequence[Sample], outputs: Outputs) -> dict[int, Record]:
        rank, size = self.ranks.rank, self.ranks.size
        mine = [k for k in range(len(samples)) if k // LANES % size == rank]
        stem = f"batch_{samples[0].row}" + ("" if size == 1 else f"_rank_{rank}_of_{size}")
        theta = {name: np.array([samples[k].theta[name] for k in mine]) for name in samples[0].theta}
        shapes = self.model.shapes(theta, len(mine))
        outcomes = Ensemble(self.model, self.settings).run(
            theta_changes(self.model.network, theta),
            len(mine),
            outputs.checkpoints / stem if self.settings.checkpoints else None,
            [outputs.fields is not None and samples[k].row < self.settings.fields for k in mine],
            Progress(),
            shapes=shapes,
        )
        solver = {"name": "ensemble", "version": provenance.code_version(), "coupling": COUPLING}
        rows = {}
        for number, (k, outcome) in enumerate(zip(mine, outcomes, strict=True)):
            domain = self.model.domain
            if shapes is not None:
                outcome.diagnostics |= {"lumen": shapes.quality[number]}
                domain = shapes.domain(number, domain)
            rows[k] = _record(samples[k], outcome, solver)
            if outcome.fields and outputs.fields is not None:
                write_fields(outputs.fields, samples[k].name, domain, outcome.fields)
        return rows


def _record(sample: Sample, outcome: Outcome, solver: dict[str, str]) -> Record:
    cost = {"cpu_s": outcome.cpu_s, "wall_s": outcome.wall_s}
    cost |= {name: outcome.diagnostics[name] for name in ("cycles", "steps") if name in outcome.diagnostics}
    diagnostics = dict(outcome.diagnostics)
    if outcome.earlier_failures:
        diagnostics["earlier_failures"] = outcome.earlier_failures
    inputs = dict(sample.theta)
    if not outcome.ok:
        return Record.failed(sample.name, inputs, outcome.reason, solver=solver, cost=cost, diagnostics=diagnostics)
    return Record(sample.name, inputs, outcome.values, solver=solver, cost=cost, diagnostics=diagnostics)


class Progress:
    """Print block, cycle and share done to standard error, with the time left if every remaining cycle is run."""

    def __init__(self, every: float = 10.0):
        self.every, self.last = every, 0.0

    def __call__(self, block: Block, share: float) -> None:
        now = time.perf_counter()
        if now - self.last < self.every:
            return
        self.last = now
        whole = block.settings.ramp_cycles + block.settings.max_cycles
        done = block.total_steps / block.steps
        spent = now - block.begun
        left = spent * max(whole - done, 0.0) / max(done, 1e-9)
        speed = abs(block.stepper.u[..., : block.samples]).max()
        print(
            f"3D samples {block.label}: cycle {block.cycle + 1}, {100 * share:.0f} % done, peak {speed:.0f} cm/s, "
            f"{spent:.0f} s elapsed, at most {left:.0f} s remaining",
            file=sys.stderr,
        )
