"""Turn the recordings of one animal into a case."""

from pathlib import Path

from coronaryuq.discrepancy.data.recordings import prepare_case
from job import job

with job(globals()) as this:
    params = this.params
    folder = Path(this.output["model"]).parent
    prepare_case(params["folder"], params["animal"], folder, params["held_out"], params["free_bed"])
