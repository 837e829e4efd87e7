"""Hyper-parameters of MFMC-AE on held-out loss."""

from pathlib import Path

from coronaryuq.estimation.campaign.tuning import tune
from coronaryuq.estimation.settings import Settings
from job import job

with job(globals()) as this:
    runs, settings = Path(this.input["params"]).parent, Settings(**this.params["settings"])
    tune(runs, this.input["rows"], settings, this.params["seed"], this.output["tuning"])
