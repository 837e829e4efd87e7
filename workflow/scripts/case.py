"""Check a case and write what every later stage starts from."""

from pathlib import Path

from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from job import job

with job(globals()) as this:
    prepare_case(this.input["case"], Settings(**this.params["settings"]), Path(this.output["case"]).parent)
