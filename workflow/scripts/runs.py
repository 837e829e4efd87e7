"""Gather the campaign's runs into the published-runs format."""

from pathlib import Path

from coronaryuq.estimation.results import Counts, read_round
from coronaryuq.estimation.runs.gather import RunFiles, gather
from job import job

with job(globals()) as this:
    posterior, grown = this.params["posterior"], this.input.get("allocation")
    counts = read_round(grown).counts if grown else Counts(**this.params["counts"])
    gather(
        RunFiles.of(this.input, this.params["runs_per_fine"]),
        {"r": posterior["prior"], "R_cor_scaling": posterior["scaling"]},
        this.params["settings"]["min_3d"],
        Path(this.output["params"]).parent,
        counts,
    )
