"""Simulate one portion of the noisy realisations of territories and flows."""

from coronaryuq.perfusion.settings import Settings
from coronaryuq.perfusion.stage import run_chunk
from job import job

with job(globals()) as this:
    first, count = this.params["portion"]
    run_chunk(
        this.input["case"],
        this.input["lv"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        first,
        count,
        this.output["chunk"],
    )
