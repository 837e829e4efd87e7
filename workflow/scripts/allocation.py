"""One round of a growing campaign: are the wanted intervals reached, and what does the next round run?"""

from coronaryuq.core.io.atomic import read_json
from coronaryuq.estimation.campaign.allocation import allocate
from coronaryuq.estimation.settings import Settings
from job import job

with job(globals()) as this:
    posterior, number = this.params["posterior"], this.params["number"]
    allocate(
        {
            "case_json": this.input["case"],
            "pilot_csv": this.input["pilot"],
            "propagation_csv": this.input["propagation"],
            "flow3d": this.input["records"],
            "zerod_pilot": this.input["zerod_pilot"],
            "zerod_propagation": this.input["zerod_propagation"],
            "coarse": this.input["coarse"],
            "runs_per_fine": this.params["runs_per_fine"],
        },
        {"r": posterior["prior"], "R_cor_scaling": posterior["scaling"]},
        Settings(**this.params["settings"]),
        this.params["seed"],
        number,
        read_json(this.input["before"])["next"] if number else this.params["first"],
        this.params["portion"],
        this.output["round"],
    )
