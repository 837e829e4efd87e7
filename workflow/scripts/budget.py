"""What a further 3D or 0D run buys."""

from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.stage import budget
from job import job

with job(globals()) as this:
    settings = Settings(**this.params["settings"])
    budget(this.input["estimates"], settings, this.output["budget"], this.input["failures"])
