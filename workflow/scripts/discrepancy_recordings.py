"""Turn the recordings of one animal into a case."""

from pathlib import Path

from coronaryuq.discrepancy.recordings import prepare
from job import job

with job(globals()) as this:
    prepare(this.params["folder"], this.params["animal"], Path(this.output["model"]).parent, this.params["held_out"])
