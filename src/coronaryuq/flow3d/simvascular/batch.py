"""Rule function of the 3D stage for the SimVascular codes: one job per sample, the same records as the ensemble
solver.
"""

import shutil
from pathlib import Path

from coronaryuq.core import provenance, records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.flow3d.simvascular.adapter import Backend, Sample, run_sample
from coronaryuq.flow3d.simvascular.common import Case, read_case
from coronaryuq.flow3d.simvascular.svmultiphysics import SvMultiPhysics
from coronaryuq.flow3d.simvascular.svsolver import SvSolver
from coronaryuq.flow3d.simvascular_settings import SimVascularSettings
from coronaryuq.zerod.network.beds import SCALING, beds

BACKENDS = {"svsolver": SvSolver, "svmultiphysics": SvMultiPhysics}


def run_external(
    backend: str,
    case_json: str | Path,
    network_json: str | Path,
    mesh_dir: str | Path,
    mesh_json: str | Path,
    samples_csv: str | Path,
    first: int,
    count: int,
    settings: SimVascularSettings,
    tasks: int,
    out_jsonl: str | Path,
    work: str | Path,
) -> None:
    """Run samples `first` to `first + count` of a table of θ, each under MPI with `tasks` processes.

    Arguments as `flow3d.stage.run_batch`. work: holds a run directory for each sample, kept when it failed. The
    records are rewritten after every sample, so that a stopped batch goes on where it was: samples that ended well and
    have the same inputs are not run again.
    """
    case = read_case(case_json, network_json, mesh_dir, mesh_json, settings)
    solver = make_backend(backend, case)
    work = Path(work) / _key(backend, case)
    kept = work / f"batch_{first}.jsonl"
    done = {record.sample: record for record in records.read(kept)} if kept.is_file() else {}
    rows = []
    for sample in read_samples(samples_csv, first, count, case):
        record = done.get(sample.name)
        if record is None or not record.ok or record.inputs != dict(sample.theta):
            record = run_sample(solver, sample, work / sample.name, tasks, settings.time_limit)
        rows.append(record)
        records.write(kept, rows)
        if record.ok and not settings.keep:
            shutil.rmtree(work / sample.name, ignore_errors=True)
    records.write(out_jsonl, rows)
    kept.unlink()


def _key(backend: str, case: Case) -> str:
    """What a kept record must agree with beside θ."""
    described = {
        "network": case.network,
        "mesh": case.geometry.description,
        "fluid": [case.density, case.viscosity],
        "settings": case.settings.model_dump(exclude={"mpi", "time_limit", "keep"}),
    }
    return f"{backend}-{provenance.digest(described)}"


def make_backend(name: str, case: Case) -> Backend:
    if name not in BACKENDS:
        raise InputError("configuration", "backend", name, f"know {', '.join(BACKENDS)} and ensemble")
    return BACKENDS[name](case)


def read_samples(samples_csv: str | Path, first: int, count: int, case: Case) -> list[Sample]:
    """Rows of a table of θ; `InputError` for too few rows or a column that is no coronary bed."""
    table = read_csv(samples_csv, ("sample",))
    chosen = table.iloc[first : first + count]
    if len(chosen) < count:
        raise InputError(samples_csv, "sample", len(table), f"want at least {first + count} rows")
    columns = [name for name in chosen.columns if name != "sample"]
    known = {*beds(case.network), SCALING}
    for column in columns:
        if column not in known:
            raise InputError(samples_csv, column, None, "is no coronary bed of the network")
    return [Sample(str(row["sample"]), {c: float(row[c]) for c in columns}) for _, row in chosen.iterrows()]
