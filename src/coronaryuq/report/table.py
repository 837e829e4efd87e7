"""The table of estimates: a line for every estimator of every row, and the warnings below it, grouped by their kind."""

import re
from collections.abc import Mapping, Sequence

from coronaryuq.estimation.results import EstimatorReport, RowReport
from coronaryuq.report.numbers import correlation
from coronaryuq.report.quantities import Digits, constant

ESTIMATORS = ("MC", "MFMC", "MFMC-AE", "BLUE", "crossfit-GP", "multilevel")


class Notes:
    """Warnings below the table: one entry per kind, with each text once and the lines that carry it."""

    def __init__(self, names: Mapping[str, str]):
        """names: what a reader calls the inputs and outputs in the warnings."""
        self._groups: dict[str, dict[str, list[str]]] = {}
        self._names = names
        self._known = re.compile("|".join(rf"\b{re.escape(name)}\b" for name in names) or "$^")

    def _readable(self, text: str) -> str:
        return self._known.sub(lambda found: self._names[found[0]], text)

    def numbers(self, warnings: Sequence[str], line: str) -> list[int]:
        """Return the numbers of the kinds of some warnings of a line of the table, adding new ones."""
        for text in warnings:
            kind, _, rest = text.partition(": ")
            self._groups.setdefault(kind, {}).setdefault(self._readable(rest or text), []).append(line)
        kinds = list(self._groups)
        return sorted({kinds.index(text.partition(": ")[0]) + 1 for text in warnings})

    @property
    def groups(self) -> list[dict]:
        """The kinds in the order of their numbers: `kind`, `count` of lines, `texts` with the lines that carry each."""
        return [
            {
                "kind": kind[:1].upper() + kind[1:],
                "count": len({line for lines in texts.values() for line in lines}),
                "texts": [{"text": text, "lines": ", ".join(dict.fromkeys(lines))} for text, lines in texts.items()],
            }
            for kind, texts in self._groups.items()
        ]


def table_lines(row: RowReport, rows: Sequence[RowReport], mesh: str, notes: Notes) -> list[dict]:
    """Return the lines of one row of `estimates.json`, whose rows are `rows`, one per estimator.

    Every number has `raw`, by which the table is sorted, as the tables of the campaign have it.
    """
    _, paired, branch = (row.label.split(", ") + ["", ""])[:3]
    digits = Digits(row.column_3d, rows)
    lines = []
    for name in ESTIMATORS:
        if name not in row.estimators:
            continue
        value, plain = row.estimators[name], name == "MC"
        label = f"{digits.kind.name} {branch}".strip()
        lines.append(
            {
                "row": row.row,
                "quantity": digits.kind.heading,
                "extreme": digits.kind.extreme,
                "branch": branch,
                "paired": paired,
                "name": name,
                "recommended": name == row.recommended,
                "method": value.method,
                "mesh": mesh,
                "cells": _cells(row, value, digits, plain),
                "notes": notes.numbers(row.warnings_of(name), label),
            }
        )
    return lines


def _cells(row: RowReport, value: EstimatorReport, digits: Digits, plain: bool) -> list[dict]:
    """Return the numbers of a line: key, text, and the raw value in the unit of the table of estimates."""
    flat = constant(row)

    def interval(key: str) -> dict:
        ends = getattr(value, key)
        text = "–" if flat else f"{digits(ends.low)} to {digits(ends.high)}"
        return {"key": key, "text": text, "raw": ends.high - ends.low}

    def rho(key: str) -> dict:
        found = None if plain else getattr(value, key)
        return {"key": key, "text": correlation(found), "raw": found}

    return [
        {
            "key": "mean",
            "text": f"{value.mean * digits.kind.scale:g}" if flat else digits(value.mean),
            "raw": value.mean,
        },
        {"key": "std", "text": "–" if flat else digits.error(value.std), "raw": value.std},
        interval("calibrated"),
        interval("chebyshev_95"),
        rho("rho_in_sample"),
        rho("rho_held_out"),
        {"key": "n_3d", "text": str(value.n_3d), "raw": value.n_3d},
        {"key": "n_0d", "text": "–" if plain else str(value.n_0d), "raw": None if plain else value.n_0d},
    ]
