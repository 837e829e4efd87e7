"""The paper's table from the published runs, its columns beside ours."""

import sys
from pathlib import Path

from coronaryuq.estimation.paper_table import paper_table, published
from coronaryuq.estimation.settings import Settings
from job import job

with job(globals()) as this:
    data, rows = published(this.params["data"])
    markdown = Path(this.output["table"]).with_suffix(".md")
    paper_table(data, rows, Settings(**this.params["settings"]), this.params["seed"], this.output["table"], markdown)
    print(markdown.read_text(), file=sys.stderr)
