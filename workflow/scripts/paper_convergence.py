"""Convergence with the number of 3D runs on the published runs."""

from coronaryuq.estimation.campaign.paper_table import published
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.stage import convergence
from job import job

with job(globals()) as this:
    data, rows = published(this.params["data"])
    convergence(data, Settings(**this.params["settings"]), this.params["seed"], this.output["convergence"], rows)
