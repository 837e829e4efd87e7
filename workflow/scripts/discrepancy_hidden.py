"""Hide an effect in the tuned loop and measure it."""

from pathlib import Path

from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import hide_in_loop
from job import job

with job(globals()) as this:
    hide_in_loop(
        this.input["rest"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        Path(this.output["model"]).parent,
    )
