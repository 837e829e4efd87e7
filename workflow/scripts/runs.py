"""Gather the campaign's runs into the published-runs format."""

from pathlib import Path

from coronaryuq.core.io.atomic import read_json
from coronaryuq.estimation.runs.gather import gather
from job import job

with job(globals()) as this:
    posterior, counts = this.params["posterior"], this.params["counts"]
    if "allocation" in this.input:
        counts = read_json(this.input["allocation"])["counts"]
    gather(
        this.input["case"],
        this.input["pilot"],
        this.input["propagation"],
        this.input["records"],
        this.input["zerod_pilot"],
        this.input["zerod_propagation"],
        {"r": posterior["prior"], "R_cor_scaling": posterior["scaling"]},
        this.params["settings"]["min_3d"],
        Path(this.output["params"]).parent,
        counts,
        this.input["coarse"],
        this.params["runs_per_fine"],
    )
