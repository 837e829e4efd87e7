"""Effects hidden on purpose and what the search made of them, as a page of its own."""

from pathlib import Path

import yaml

from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.discrepancy_benchmark import words
from coronaryuq.report.discrepancy import embedded, environment

CAPTION = (
    "Left: cases of the first network by what was hidden and what was named first. Right: shares of all networks with "
    "their 95 % intervals; grey: wanted."
)


def write_page(shares: str, cells: str, answers: str, figure: str, settings: dict, out: str | Path) -> None:
    """Write the page. shares, cells, answers: tables of `bench.discovery_tables`; figure: PNG."""
    table, named = read_csv(cells), read_csv(answers)
    context = {
        "shares": [_share(row) for row in read_csv(shares).itertuples()],
        "figure": embedded(figure),
        "caption": CAPTION,
        "networks": [
            {"name": name, "cells": [_cell(row, named[named["network"] == name]) for row in mine.itertuples()]}
            for name, mine in table.groupby("network", sort=False)
        ],
        "settings": yaml.safe_dump(settings, sort_keys=False),
    }
    write_text(out, environment().get_template("discovery_page.html").render(context))


def wanted(least: float, most: float) -> str:
    """What a share should be, from and to."""
    if most == 0:
        return "0"
    return f"≥ {least:.2f}" if most == 1 else f"≤ {most:.2f}" if least == 0 else f"{least} to {most}"


def _share(row) -> dict:
    told = {"tested": row.tested, "on": row.on, "held": row.held, "trials": row.trials, "share": f"{row.share:.3f}"}
    return told | {"interval": f"{row.low:.3f} to {row.high:.3f}", "wanted": wanted(row.wanted_from, row.wanted_to)}


def _cell(row, named) -> dict:
    firsts = named[named["hidden"] == row.effect].sort_values("cases", ascending=False, kind="stable")
    size = "" if row.strength == "none" else f"{row.strength}, "
    return {
        "effect": words(row.effect),
        "size": f"{size}{row.noise}",
        "right": f"{row.right} of {row.cases}" if row.cases else "–",
        "skipped": row.skipped or "–",
        "cpu_s": f"{row.cpu_s:.3g}" if row.cases else "–",
        "named": ", ".join(f"{words(one.named)} ({one.cases})" for one in firsts.itertuples()),
    }
