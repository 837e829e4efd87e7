"""The page of the benchmark of hidden effects."""

from pathlib import Path

import pandas as pd
import yaml

from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.discrepancy_benchmark import cell_label
from coronaryuq.report.discrepancy import environment
from coronaryuq.report.embedding import data_url

CAPTION = (
    "Left: cases of the first network by hidden effect and first answer. Right: fractions on all networks, with 95 % "
    "intervals; grey: targets."
)


def write_page(shares: str, cells: str, answers: str, figure: str, settings: dict, out: str | Path) -> None:
    """Write the page.

    Parameters
    ----------
    shares, cells, answers
        Tables of `bench.discrepancy.tables`, CSV.
    figure
        PNG file.
    settings
        Settings of the benchmark.
    out
        The page, HTML.
    """
    table, answered = read_csv(cells), read_csv(answers)
    context = {
        "shares": [_share(row) for row in read_csv(shares).itertuples()],
        "figure": data_url(figure),
        "caption": CAPTION,
        "networks": [
            {"name": name, "cells": [_cell(row, answered[answered["network"] == name]) for row in part.itertuples()]}
            for name, part in table.groupby("network", sort=False)
        ],
        "settings": yaml.safe_dump(settings, sort_keys=False),
    }
    write_text(out, environment().get_template("discrepancy_benchmark.html").render(context))


def target(least: float, most: float) -> str:
    """Format the target range of a fraction."""
    if most == 0:
        return "0"
    return f"≥ {least:.2f}" if most == 1 else f"≤ {most:.2f}" if least == 0 else f"{least} to {most}"


def _share(row) -> dict:
    share = {
        "tested": row.tested,
        "on": row.on,
        "held": row.held,
        "trials": row.trials,
        "fraction": f"{row.fraction:.3f}",
    }
    return share | {"interval": f"{row.low:.3f} to {row.high:.3f}", "target": target(row.target_from, row.target_to)}


def _cell(row, answers: pd.DataFrame) -> dict:
    firsts = answers[answers["hidden"] == row.effect].sort_values("cases", ascending=False, kind="stable")
    size = "" if row.strength == "none" else f"{row.strength}, "
    return {
        "effect": cell_label(row.effect),
        "size": f"{size}{row.noise}",
        "right": f"{row.right} of {row.cases}" if row.cases else "–",
        "skipped": row.skipped or "–",
        "cpu_s": f"{row.cpu_s:.3g}" if row.cases else "–",
        "named": ", ".join(f"{cell_label(answer.named)} ({answer.cases})" for answer in firsts.itertuples()),
    }
