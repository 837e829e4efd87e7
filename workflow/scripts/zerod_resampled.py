"""Run one share of the resampled inputs through the 0D model."""

from coronaryuq.core.io.tables import read_csv
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.stage import run_chunk
from job import job

with job(globals()) as this:
    k, shares = this.params["share"]
    total = len(read_csv(this.input["samples"]))
    first, last = total * k // shares, total * (k + 1) // shares
    settings = Settings(**this.params["settings"])
    run_chunk(
        this.input["network"],
        this.input["case"],
        this.input["samples"],
        first,
        last - first,
        settings,
        this.output["runs"],
    )
