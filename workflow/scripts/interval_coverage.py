"""Coverage of the intervals at one pilot size: analytic pairs, and the published runs where there are any."""

from coronaryuq.bench.estimation.coverage import run
from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.campaign.paper_table import published
from job import job

with job(globals()) as this:
    named = this.params["data"]
    data, rows = published(named) if named else (None, None)
    size, trials = this.params["size"], this.params["trials"]
    write_json(this.output["cells"], run(data=data, rows=rows, trials=trials, sizes=(size,)))
