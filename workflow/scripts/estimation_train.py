"""Train the shared space of every row; write the 0D inputs that it asks for."""

from pathlib import Path

from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.stage import train
from job import job

with job(globals()) as this:
    train(
        Path(this.input["params"]).parent,
        Settings(**this.params["settings"]),
        this.params["seed"],
        this.output["networks"],
        this.output["resampled"],
    )
