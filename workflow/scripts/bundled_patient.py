"""Make the bundled patient, in the formats that a real case uses."""

from pathlib import Path

from coronaryuq.synthetic.settings import Settings
from coronaryuq.synthetic.stage import write_patient
from job import job

with job(globals()) as this:
    write_patient(Settings(**this.params["settings"]), this.params["seed"], Path(this.output["case"]).parent)
