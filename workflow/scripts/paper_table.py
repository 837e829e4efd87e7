"""The paper's table from the published runs, its columns beside ours."""

import sys
from pathlib import Path

from coronaryuq.estimation.campaign.paper_table import paper_table, published
from coronaryuq.estimation.settings import Settings
from job import job

with job(globals()) as this:
    data, rows = published(this.params["data"])
    markdown = Path(this.output["table"]).with_suffix(".md")
    folder = Path(this.output["estimates"]).parent
    settings, seed = Settings(**this.params["settings"]), this.params["seed"]
    paper_table(data, rows, settings, seed, this.output["table"], markdown, folder)
    print(markdown.read_text(), file=sys.stderr)
