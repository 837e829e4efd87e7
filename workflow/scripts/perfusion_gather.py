"""Gather the realisations to target flows and their covariance."""

from coronaryuq.perfusion.settings import Settings
from coronaryuq.perfusion.stage import gather
from job import job

with job(globals()) as this:
    gather(
        this.input["chunks"],
        this.input["case"],
        this.input["lv"],
        Settings(**this.params["settings"]),
        this.output["targets"],
    )
