"""Run one batch of pilot samples in 3D; pack the fields of those samples whose fields are kept."""

import tempfile
import zipfile
from pathlib import Path

from coronaryuq.core.io.atomic import replacing
from coronaryuq.flow3d.adapter import Batch, Outputs, Processes
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.stage import run_batch
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples
from job import job


def pack(folder: Path, archive: str) -> None:
    """All files of a folder in one archive without times, so that equal fields are equal bytes."""
    with replacing(archive) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in sorted(folder.iterdir()):
            packed.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)


with job(globals()) as this, tempfile.TemporaryDirectory() as scratch:
    first, count = this.params["portion"]
    samples, fields = Path(scratch, "samples.csv"), Path(scratch, "fields")
    fields.mkdir()
    posterior = PosteriorSettings(**this.params["posterior"])
    draw_samples(this.input["draws"], posterior, this.params["seed"], "pilot", first + count, samples)
    batch = Batch(
        case=this.input["case"],
        network=this.input["network"],
        mesh_folder=this.input["mesh_folder"],
        mesh=this.input["mesh"],
        samples=samples,
        first=first,
        count=count,
    )
    records = Path(this.output["records"])
    outputs = Outputs(records, records.parent / "checkpoints", fields)
    settings, processes = Settings(**this.params["settings"]), Processes(mpi=this.mpi, tasks=this.tasks)
    run_batch(batch, this.params["backend"], settings, outputs, processes)
    pack(fields, this.output["fields"])
