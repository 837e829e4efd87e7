"""Lowest FFR of each artery, pressure drops and the places of a wire on the page, from `predicted.csv`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.anatomy.wire_places import distance_from_ostium
from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import FFR_LIMIT, colour
from coronaryuq.report.tree import Readings
from coronaryuq.zerod.predicted import COLUMNS, DROP, LOWEST, WIRE


def read_predicted(path: str | Path) -> pd.DataFrame:
    """Read `predicted.csv`."""
    return read_csv(path, columns=COLUMNS)


def lowest(predicted: pd.DataFrame, readings: Readings) -> dict:
    """Return the lowest of the arteries' lowest FFR, its 90 % range, where it is and of which artery; or nothing.

    in_artery: whether it is in the artery itself, not in a branch of another name.
    """
    arteries = predicted[predicted["quantity"] == LOWEST]
    if arteries.empty:
        return {}
    row = arteries.loc[arteries["median"].idxmin()]
    values = {name: _ffr(row[column]) for name, column in (("ffr", "median"), ("ffr_low", "low"), ("ffr_high", "high"))}
    where = _place(readings.tree, readings.names, row["vessel"], row["arc"])
    return {
        "where": where,
        "artery": str(row["artery"]),
        "in_artery": readings.names[row["vessel"]] == row["artery"],
        "below": bool(row["median"] <= FFR_LIMIT),
        **values,
    }


def lines(predicted: pd.DataFrame, readings: Readings) -> list[dict]:
    """Return the lines of the page's table, one per row of `predicted.csv`.

    Each has `name`, `colour` of the artery, `what`, `where`, `median`, `range`, and `below`: whether the median of an
    FFR is at most 0.80; of a place of a wire `measured` and `comparison`, empty if none was measured, `apart`, whether
    they disagree, and `with_sd`, whether the wire's error is known.
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
                "where": _where(row, readings),
                "median": median,
                "range": f"{low} to {high}",
                "below": not in_mmhg and row["median"] <= FFR_LIMIT,
                **_comparison(row),
            }
        )
    return result


def _where(row: Mapping[str, Any], readings: Readings) -> str:
    if row["quantity"] == DROP:
        return "from its start to its end"
    place = _place(readings.tree, readings.names, row["vessel"], row["arc"])
    if row["quantity"] != WIRE:
        return place
    return f"{distance_from_ostium(readings.tree, row['vessel'], row['arc']):.1f} cm from the ostium, {place}"


def _comparison(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the measured value and how the prediction compares, in words; empty texts where none was measured."""
    if pd.isna(row["measured"]):
        return {"measured": "", "comparison": "", "apart": False, "with_sd": False}
    with_sd, difference = not pd.isna(row["sd"]), row["difference"]
    lies = "within" if row["within"] == "yes" else "outside"
    same = abs(difference) < 0.005
    words = "predicted alike" if same else f"predicted {abs(difference):.2f} {'higher' if difference > 0 else 'lower'}"
    return {
        "measured": _ffr(row["measured"]) + (f" ± {row['sd']:.2g}" if with_sd else ""),
        "comparison": f"{words}; {lies} {_ffr(row['expected_low'])} to {_ffr(row['expected_high'])}",
        "apart": lies == "outside",
        "with_sd": with_sd,
    }


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
