"""The table of estimates: all estimators of each row, and the numbered warnings below it."""

from collections.abc import Sequence

from coronaryuq.estimation.results import RowReport
from coronaryuq.report.mesh_error import EXTREMES
from coronaryuq.report.numbers import correlation, interval, number

ESTIMATORS = ("MC", "MFMC", "MFMC-AE", "BLUE", "crossfit-GP", "multilevel")


class Notes:
    """Warnings below the table, each listed once and cited by its number."""

    def __init__(self):
        self.texts: list[str] = []

    def numbers(self, warnings: Sequence[str]) -> str:
        """Return the numbers of warnings, adding new ones to the list."""
        for text in warnings:
            if text not in self.texts:
                self.texts.append(text)
        return " ".join(f"[{self.texts.index(text) + 1}]" for text in warnings)


def table_row(row: RowReport, notes: Notes) -> dict:
    """Return one row of `estimates.json` as the template shows it: a line per estimator."""
    quantity, paired, branch = (row.label.split(", ") + ["", ""])[:3]
    extreme = row.column_3d.startswith(tuple(EXTREMES))
    lines = []
    for name in ESTIMATORS:
        if name not in row.estimators:
            continue
        value = row.estimators[name]
        plain = name == "MC"
        of_row = row.warnings if name == row.recommended or not plain else []
        lines.append(
            {
                "estimator": value.method + (" ✓" if name == row.recommended else ""),
                "mean": number(value.mean, 4),
                "std": number(value.std),
                "chebyshev": " to ".join(interval(value.chebyshev_95.low, value.chebyshev_95.high)),
                "calibrated": " to ".join(interval(value.calibrated.low, value.calibrated.high)),
                "rho_in": "–" if plain else correlation(value.rho_in_sample),
                "rho_out": "–" if plain else correlation(value.rho_held_out),
                "n_3d": value.n_3d,
                "n_0d": "–" if plain else value.n_0d,
                "notes": notes.numbers([*of_row, *value.warnings]),
            }
        )
    return {"quantity": quantity, "paired": paired, "branch": branch, "extreme": extreme, "lines": lines}
