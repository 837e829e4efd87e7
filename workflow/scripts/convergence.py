"""Convergence of the estimators with the number of 3D runs."""

from pathlib import Path

from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.stage import convergence
from job import job

with job(globals()) as this:
    runs, settings = Path(this.input["params"]).parent, Settings(**this.params["settings"])
    convergence(runs, settings, this.params["seed"], this.output["convergence"])
