"""Cells of all pilot sizes as one table."""

from coronaryuq.bench.estimation.coverage import tabulate
from job import job

with job(globals()) as this:
    tabulate(list(this.input["cells"]), this.output["table"])
