"""Find what the model is missing, from a network, measurements and their conditions."""

from pathlib import Path

from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import search
from job import job

with job(globals()) as this:
    search(
        this.input["model"],
        this.input["measurements"],
        this.input["conditions"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        Path(this.output["answer"]).parent,
        threads=this.threads,
    )
