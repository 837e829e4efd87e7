"""One round of a growing campaign: are the wanted intervals reached, and what does the next round run?"""

from coronaryuq.estimation.campaign.allocation import allocate
from coronaryuq.estimation.results import Counts, read_round
from coronaryuq.estimation.runs.gather import RunFiles
from coronaryuq.estimation.settings import Settings
from job import job

with job(globals()) as this:
    posterior, number = this.params["posterior"], this.params["number"]
    allocate(
        RunFiles.of(this.input, this.params["runs_per_fine"]),
        {"r": posterior["prior"], "R_cor_scaling": posterior["scaling"]},
        Settings(**this.params["settings"]),
        this.params["seed"],
        number,
        read_round(this.input["before"]).next if number else Counts(**this.params["first"]),
        Counts(**this.params["portion"]),
        this.output["round"],
    )
