"""Tune the closed loop to the patient's clinical targets."""

import sys
from pathlib import Path

from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.stage import tune
from job import job

with job(globals()) as this:
    tune(
        this.input["case"],
        this.input["network"],
        this.input["targets"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        Path(this.output["rest"]).parent,
        threads=this.threads,
        report=lambda line: print(line, file=sys.stderr),
    )
