"""Estimate every row with every estimator."""

from pathlib import Path

from coronaryuq.estimation.campaign.pairs_table import write_pairs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.stage import estimate
from job import job

with job(globals()) as this:
    runs, settings, seed = Path(this.input["params"]).parent, Settings(**this.params["settings"]), this.params["seed"]
    networks, zerod = this.input["networks"], this.input["zerod"]
    write_pairs(runs, networks, zerod, settings, seed, this.output["pairs"])
    estimate(runs, networks, zerod, settings, seed, this.output["estimates"], this.output["table"])
