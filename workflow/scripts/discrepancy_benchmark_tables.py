"""Cases of the discrepancy benchmark, all networks and seeds, as tables."""

from pathlib import Path

from coronaryuq.bench.discrepancy.tables import tabulate
from job import job

with job(globals()) as this:
    tabulate(this.input["cases"], *(Path(this.output[name]) for name in ("shares", "cells", "answers")))
