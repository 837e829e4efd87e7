"""Run the DREAM chains; under `mpiexec` or `srun` the ranks share the 0D runs."""

from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import sample
from job import job

with job(globals()) as this:
    sample(
        this.input["case"],
        this.input["network"],
        this.input["targets"],
        Settings(**this.params["settings"]),
        this.params["seed"],
        this.output["chains"],
        threads=this.threads,
    )
