"""Gather the chains: posterior, draws, verdict, predictive checks."""

from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import GatheredFiles, gather
from job import job

with job(globals()) as this:
    gather(
        this.input["case"],
        this.input["network"],
        this.input["targets"],
        this.input["chains"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        GatheredFiles(**this.output),
    )
