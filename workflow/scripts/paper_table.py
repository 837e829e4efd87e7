"""The paper's table from the published runs, its columns beside ours."""

import sys
from pathlib import Path

from coronaryuq.errors import InputError
from coronaryuq.estimation.paper_table import paper_table
from coronaryuq.estimation.settings import Settings
from job import job

with job(globals()) as this:
    data = this.params["data"]
    if data is None:
        raise InputError("configuration", "paper_data", None, "name the folder with the published runs")
    rows = next((path for path in (Path(data, "rows.csv"), Path(data, "table1.csv")) if path.exists()), None)
    if rows is None:
        raise InputError(
            data, "rows.csv or table1.csv", None, "no such file; is this the folder of the published runs?"
        )
    markdown = Path(this.output["table"]).with_suffix(".md")
    paper_table(data, rows, Settings(**this.params["settings"]), this.params["seed"], this.output["table"], markdown)
    print(markdown.read_text(), file=sys.stderr)
