"""Run one batch of pilot samples in 3D, by the ensemble solver or by an external one."""

import tempfile
import zipfile
from pathlib import Path

from coronaryuq.core.io.atomic import replacing
from coronaryuq.flow3d.adapter import Batch, Outputs, Processes
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.stage import run_batch
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples


def batch(
    case_json: str, tree_vtp: str, network_json: str, mesh_dir: str, mesh_json: str, draws_csv: str, settings: Settings,
    posterior: PosteriorSettings, backend: str, seed: int, portion: tuple[int, int], records_jsonl: str,
    fields_zip: str, mpi: str, tasks: int,
) -> None:  # fmt: skip
    """Draw the samples of one portion (first, count) of the pilot, run them, and pack the fields to be kept."""
    first, count = portion
    records = Path(records_jsonl)
    with tempfile.TemporaryDirectory() as scratch:
        samples, fields = Path(scratch, "samples.csv"), Path(scratch, "fields")
        fields.mkdir()
        draw_samples(draws_csv, posterior, seed, "pilot", first + count, samples)
        inputs = {
            "case": case_json,
            "network": network_json,
            "mesh_folder": mesh_dir,
            "mesh": mesh_json,
            "tree": tree_vtp,
        }
        outputs = Outputs(records, records.parent / "checkpoints", fields)
        part = Batch(**inputs, samples=samples, first=first, count=count)
        run_batch(part, backend, settings, outputs, Processes(mpi=mpi, tasks=tasks))
        pack(fields, fields_zip)


def teaching_batch(
    case_json: str, tree_vtp: str, network_json: str, mesh_dir: str, mesh_json: str, samples_csv: str,
    settings: Settings, backend: str, number: int, records_jsonl: str, mpi: str, tasks: int,
) -> None:  # fmt: skip
    """Run the samples that teach the 0D model its losses in 3D."""
    records = Path(records_jsonl)
    part = Batch(case_json, network_json, mesh_dir, mesh_json, samples_csv, 0, number, tree_vtp)
    outputs = Outputs(records, records.parent / "checkpoints")
    run_batch(part, backend, settings, outputs, Processes(mpi=mpi, tasks=tasks))


def pack(folder: Path, archive: str | Path) -> None:
    """Pack all files of a folder without modification times, so that equal fields give equal bytes."""
    with replacing(archive) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in sorted(folder.iterdir()):
            packed.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)
