"""Write the page of the discrepancy benchmark."""

from coronaryuq.report.discrepancy_benchmark import write_page
from job import job

with job(globals()) as this:
    tables = {name: this.input[name] for name in ("shares", "cells", "answers")}
    write_page(**tables, figure=this.input["figure"], settings=this.params["settings"], out=this.output["report"])
