"""Run one batch of pilot samples in 3D; pack the fields of those samples whose fields are kept."""

import tempfile
import zipfile
from pathlib import Path

from coronaryuq.core.io.atomic import replacing
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.simvascular.batch import run_external
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
    settings = Settings(**this.params["settings"])
    common = (
        this.input["case"],
        this.input["network"],
        this.input["mesh_folder"],
        this.input["mesh"],
        samples,
        first,
        count,
    )
    checkpoints = Path(this.output["records"]).parent / "checkpoints"
    if this.params["backend"] == "ensemble":
        run_batch(*common, settings, this.output["records"], checkpoints, fields)
    else:
        run_external(
            this.params["backend"],
            *common,
            settings.simvascular.model_copy(update={"mpi": this.mpi}),
            this.tasks,
            this.output["records"],
            checkpoints,
        )
    pack(fields, this.output["fields"])
