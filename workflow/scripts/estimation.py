"""Estimate every row with every estimator."""

from pathlib import Path

from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.stage import estimate
from job import job

with job(globals()) as this:
    estimate(
        Path(this.input["params"]).parent,
        this.input["networks"],
        this.input["zerod"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        this.output["estimates"],
        this.output["table"],
    )
