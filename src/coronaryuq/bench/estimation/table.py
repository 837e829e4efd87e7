"""Benchmark `table`: the paper's table from anyone's published runs, with its CPU time."""

import argparse
import os
import time
from pathlib import Path

from coronaryuq.core.errors import InputError
from coronaryuq.estimation.analysis.paper_table import paper_table
from coronaryuq.estimation.settings import Settings

SEED = 20241117


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--data", metavar="FOLDER", help="folder of the published runs (required)")
    parser.add_argument("--rows", metavar="FILE", help="columns row, column_3d, column_0d (default: FOLDER/table1.csv)")


def run(quick: bool = False, data: str | None = None, rows: str | None = None) -> dict:
    """Return the keys of the list of benchmarks; `cpu_s` is user + system time of the whole run, `cpu_s_parts` by part.

    `quick` trains the autoencoders for a tenth of the steps. `rows` defaults to `table1.csv` in `data`.
    """
    if data is None:
        raise InputError("bench table", "--data", None, "name the folder of published runs")
    folder = Path(data).absolute()  # so that a message about one of its files contains its full path, also for "."
    settings = Settings(steps=(300, 200)) if quick else Settings()
    start, wall = _cpu(), time.perf_counter()
    lines, parts = paper_table(folder, rows or folder / "table1.csv", settings, SEED)
    return {"rows": lines, "cpu_s": _cpu() - start, "cpu_s_parts": parts, "wall_s": time.perf_counter() - wall}


def _cpu() -> float:
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system
