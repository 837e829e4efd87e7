"""Write the page of a discrepancy campaign."""

from coronaryuq.report.discrepancy import write_page
from job import job

with job(globals()) as this:
    write_page(
        this.input["answers"],
        this.input["figures"],
        this.params["campaign"],
        this.params["settings"],
        this.output["report"],
        this.input["truths"],
    )
