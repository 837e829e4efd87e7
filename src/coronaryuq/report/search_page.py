"""The page of searches that were run by themselves, without a campaign."""

from collections.abc import Mapping
from itertools import count
from pathlib import Path

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.draw import draw
from coronaryuq.report.captions import PAIRS_TABLES, SEARCHES
from coronaryuq.report.discrepancy import environment, searched, title

ANSWER = "discrepancy.json"


def write_search_page(out: Path, found: Mapping[str, Path], note: str = "") -> Path:
    """Draw the figures of searches, and write a page with them.

    Parameters
    ----------
    out
        Folder of the page, `report.html`, with its figures embedded.
    found
        Title of each search → folder of its answer, where its figures are drawn, in `figures`. A figure without content
        is left out.
    note
        What holds for all searches together.

    Returns
    -------
    Path
        The page.
    """
    numbers, shown = count(1), []
    for name, folder in found.items():
        figures = [_drawn(folder, figure) for figure in SEARCHES if _has_content(folder, figure)]
        shown.append(searched(folder / ANSWER, name, figures, numbers))
    context = {
        "campaign": "",
        "title": title(shown),
        "note": note,
        "searches": shown,
        "settings": "",
        "provenance": [
            (f"SHA-256 of {ANSWER}, {name}", provenance.checksum(folder / ANSWER)) for name, folder in found.items()
        ],
    }
    page = out / "report.html"
    write_text(page, environment().get_template("discrepancy_page.html").render(context))
    return page


def _table(folder: Path, figure: str) -> Path:
    return folder / f"{PAIRS_TABLES.get(figure, figure)}.csv"


def _has_content(folder: Path, figure: str) -> bool:
    table = _table(folder, figure)
    return table.exists() and not read_csv(table, ()).empty


def _drawn(folder: Path, figure: str) -> str:
    output = folder / "figures" / f"{figure}.png"
    output.parent.mkdir(exist_ok=True)
    draw(f"discrepancy_{figure}", {"table": str(_table(folder, figure))}, str(output))
    return str(output)
