"""Find what a table model is missing, from pairs of simulated and measured outputs."""

from pathlib import Path

from coronaryuq.discrepancy.table_model.search import discover_pairs
from job import job

with job(globals()) as this:
    folder = Path(this.output["answer"]).parent
    discover_pairs(this.input["simulated"], this.input["measured"], folder, this.params["seed"])
