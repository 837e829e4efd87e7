"""Compute the paper's table and convergence study from its published runs."""

import sys
from pathlib import Path

from coronaryuq.estimation import stage
from coronaryuq.estimation.analysis.paper_table import paper_table, published
from coronaryuq.estimation.settings import Settings


def table(data: str | None, settings: Settings, seed: int, table_csv: str, out_dir: Path) -> None:
    """Write the table next to the paper's columns, as CSV and Markdown, and the data of its figures."""
    folder, rows = published(data)
    markdown = Path(table_csv).with_suffix(".md")
    paper_table(folder, rows, settings, seed, table_csv, markdown, out_dir)
    print(markdown.read_text(encoding="utf-8"), file=sys.stderr)


def convergence(data: str | None, settings: Settings, seed: int, out_json: str) -> None:
    """Write the convergence study of the published runs."""
    folder, rows = published(data)
    stage.convergence(folder, settings, seed, out_json, rows, shown="max OSI")
