"""Hide effects in a network, one seed of every cell, and see whether the search names them."""

from pathlib import Path

from coronaryuq.bench.discrepancy.benchmark import run
from coronaryuq.core.io.atomic import write_json
from job import job

with job(globals()) as this:
    cases = Path(this.output["cases"])
    finished = cases.with_suffix(".finished.jsonl")
    found = run(
        quick=False,
        network=this.input.get("network"),
        offset=this.params["seed"],
        name=this.params["name"],
        threads=this.threads,
        resume=finished,
    )
    write_json(cases, found)
    finished.unlink()
