"""Lowest FFR of each artery and pressure drop over each lesion on the page, from `predicted.csv`."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import FFR_LIMIT, colour
from coronaryuq.report.tree import Readings
from coronaryuq.zerod.predicted import COLUMNS, DROP, LOWEST


def read_predicted(path: str | Path) -> pd.DataFrame:
    """Read `predicted.csv`."""
    return read_csv(path, columns=COLUMNS)


def lowest(predicted: pd.DataFrame, readings: Readings) -> dict:
    """Return the lowest of the arteries' lowest FFR, its 90 % range, and where it is; empty without one."""
    arteries = predicted[predicted["quantity"] == LOWEST]
    if arteries.empty:
        return {}
    row = arteries.loc[arteries["median"].idxmin()]
    values = {name: _ffr(row[column]) for name, column in (("ffr", "median"), ("ffr_low", "low"), ("ffr_high", "high"))}
    where = _place(readings.tree, readings.names, row["vessel"], row["arc"])
    return {"where": where, "below": bool(row["median"] <= FFR_LIMIT), **values}


def lines(predicted: pd.DataFrame, readings: Readings) -> list[dict]:
    """Return the lines of the page's table, one per row of `predicted.csv`.

    Each has `name`, `colour` of the artery, `what`, `where`, `median`, `range`, and `below`: whether the median of an
    FFR is at most 0.80.
    """
    result = []
    for row in predicted.to_dict("records"):
        in_mmhg = row["unit"] == "mmHg"
        median, low, high = (_mmhg(row[key]) if in_mmhg else _ffr(row[key]) for key in ("median", "low", "high"))
        result.append(
            {
                "name": f"{row['name']} stenosis" if row["quantity"] == DROP else row["name"],
                "colour": colour(row["artery"]),
                "what": f"{row['quantity'][:1].upper()}{row['quantity'][1:]}{' (mmHg)' if in_mmhg else ''}",
                "where": "from its start to its end"
                if row["quantity"] == DROP
                else _place(readings.tree, readings.names, row["vessel"], row["arc"]),
                "median": median,
                "range": f"{low} to {high}",
                "below": not in_mmhg and row["median"] <= FFR_LIMIT,
            }
        )
    return result


def _place(tree: Tree, names: Mapping[str, str], vessel: str, arc: float) -> str:
    """Return a place in words, with the diameter there."""
    whole = tree[vessel]
    at_end = not tree.children(vessel) and arc >= whole.length - 1e-6
    where = f"{'at the end of the' if at_end else 'in the'} {names[vessel]}"
    return f"{where} (diameter there {20 * float(whole.radius_at(arc)):.1f} mm)"


def _ffr(value: float) -> str:
    return f"{value:.2f}"


def _mmhg(value: float) -> str:
    return f"{value:.1f}"
