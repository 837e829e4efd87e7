"""Rule function of the 3D stage: a batch of samples in, one record per sample out."""

import sys
import time
from pathlib import Path

from coronaryuq.case.case_json import read_case
from coronaryuq.core import provenance, records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.ranks import Ranks
from coronaryuq.core.records import Record
from coronaryuq.flow3d.ensemble.block import Block, Outcome
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.ensemble.fields import write_fields
from coronaryuq.flow3d.ensemble.geometry import read_geometry
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.settings import Settings
from coronaryuq.zerod.network.beds import SCALING, beds, theta_changes
from coronaryuq.zerod.network.read import read_network

COUPLING = "closed loop, monolithic at every step"


def run_batch(
    case_json: str | Path,
    network_json: str | Path,
    mesh_dir: str | Path,
    mesh_json: str | Path,
    samples_csv: str | Path,
    first: int,
    count: int,
    settings: Settings,
    out_jsonl: str | Path,
    checkpoint_dir: str | Path,
    fields_dir: str | Path | None = None,
    ranks: Ranks | None = None,
) -> None:
    """Run samples `first` to `first + count` of a table of θ and write one record each.

    network_json: the tuned loop at hyperaemia. samples_csv: `sample`, one column per bed (multiplier of r-hat) and
    `R_cor_scaling`. Outputs are named as docs/architecture.md says; cap flows mL/s, pressures and stresses dyn/cm2.
    A sample that blows up is run again with smaller steps, then recorded as failed. A sample's numbers do not depend
    on how the table is cut into batches. fields_dir: where fields of the campaign's first samples go, as VTU and VTP.
    ranks: MPI ranks that share the batch, every one a block of samples at a time; the numbers are the same for any.
    """
    ranks = ranks or Ranks()
    case, network = read_case(case_json, "aorta.pressure", "density", "viscosity"), read_network(network_json)
    table = read_csv(samples_csv, ("sample",))
    theta = table.iloc[first : first + count]
    if len(theta) < count:
        raise InputError(samples_csv, "sample", len(table), f"want at least {first + count} rows")
    columns = [name for name in theta.columns if name != "sample"]
    known = {*beds(network), SCALING}
    for column in columns:
        if column not in known:
            raise InputError(samples_csv, column, None, f"is no coronary bed of {network_json}")
    geometry = read_geometry(mesh_dir, mesh_json)
    ensemble = Ensemble(
        geometry, network, case["aorta"]["pressure"], case["density"], case["viscosity"], settings
    )  # fmt: skip
    mine = [k for k in range(count) if k // LANES % ranks.size == ranks.rank]
    part = theta.iloc[mine]
    stem = f"batch_{first}" if ranks.size == 1 else f"batch_{first}_rank_{ranks.rank}_of_{ranks.size}"
    checkpoint = Path(checkpoint_dir) / stem if settings.checkpoints else None
    solver = {"name": "ensemble", "version": provenance.code_version(), "coupling": COUPLING}

    def share() -> dict[int, Record]:
        outcomes = ensemble.run(
            theta_changes(network, {name: part[name].to_numpy(float) for name in columns}),
            len(mine),
            checkpoint,
            [fields_dir is not None and first + k < settings.fields for k in mine],
            Progress(len(mine)),
        )
        rows = {}
        for k, outcome in zip(mine, outcomes, strict=True):
            sample = str(theta["sample"].iloc[k])
            rows[k] = _record(sample, {name: float(theta[name].iloc[k]) for name in columns}, outcome, solver)
            if outcome.fields:
                write_fields(Path(fields_dir), sample, geometry, outcome.fields)
        return rows

    rows = {k: row for found in ranks.gather(share) for k, row in found.items()}
    if ranks.rank == 0:
        records.write(out_jsonl, [rows[k] for k in range(count)])


def _record(sample: str, inputs: dict[str, float], outcome: Outcome, solver: dict[str, str]) -> Record:
    cost = {"cpu_s": outcome.cpu_s, "wall_s": outcome.wall_s}
    cost |= {name: outcome.diagnostics[name] for name in ("cycles", "steps") if name in outcome.diagnostics}
    diagnostics = {name: value for name, value in outcome.diagnostics.items() if name != "retry"}
    if not outcome.ok:
        return Record.failed(sample, inputs, outcome.reason, solver=solver, cost=cost, diagnostics=diagnostics)
    return Record(sample, inputs, outcome.values, solver=solver, cost=cost, diagnostics=diagnostics)


class Progress:
    """Lines on standard error: block, cycle, share done, time left if every block needs as many cycles as the last."""

    def __init__(self, samples: int, every: float = 10.0):
        self.samples, self.every = samples, every
        self.begun, self.last = time.perf_counter(), 0.0

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
            f"3D samples {block.label}: cycle {block.cycle + 1}, {100 * share:.0f} % of it, fastest {speed:.0f} cm/s, "
            f"{spent:.0f} s spent, at most {left:.0f} s left for these",
            file=sys.stderr,
        )
