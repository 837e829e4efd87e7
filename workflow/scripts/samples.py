"""Draw the samples of one input set."""

from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import draw_samples
from job import job

with job(globals()) as this:
    settings = Settings(**this.params["settings"])
    draw_samples(
        this.input["draws"],
        settings,
        this.params["seed"],
        this.params["set"],
        this.params["total"],
        this.output["samples"],
    )
