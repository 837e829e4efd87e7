"""Put the held-out gap with the true effect beside those of a search that did not know it."""

from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import compare
from job import job

with job(globals()) as this:
    compare(
        {name: this.input[name] for name in ("model", "measurements", "conditions")},
        this.input["truth"],
        {name: this.input[name] for name in ("gaps", "answer")},
        Settings(**this.params["settings"]),
        this.params["seed"],
        {name: this.output[name] for name in ("table", "reference")},
        threads=this.threads,
    )
