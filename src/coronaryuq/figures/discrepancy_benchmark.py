"""Figure of the benchmark `discrepancy`: what was hidden against what was named, and shares with their intervals."""

from pathlib import Path

import numpy as np

from coronaryuq.figures.style import MUTED, SIMULATED, saved
from coronaryuq.files import read_json

SHARES = {
    "identification": ("right name or class", 0.95, 1.0),
    "place": ("right place", 0.90, 1.0),
    "false_alarm": ("false alarm, nothing hidden", 0.0, 0.05),
    "abstention": ("abstention, outside the library", 0.85, 1.0),
    "both_of_two": ("both of two effects", 0.80, 1.0),
    "interval_coverage_90": ("90 % interval holds the size", 0.85, 0.95),
    "gap_closed_above_90": ("gap closed to 90 % of the true effect's", 0.90, 1.0),
    "worse_than_recalibration": ("worse than recalibration", 0.0, 0.0),
}
"""Words, and the range that is wanted, of each total."""


def benchmark(result: str | Path, output: str | Path) -> None:
    """From the benchmark's JSON: confusion matrix (first name given), and totals with 95 % Wilson intervals."""
    found = read_json(result)
    confusion = found["confusion"]
    rows = list(confusion)
    named = dict.fromkeys([*(row for row in rows if "+" not in row and ":" not in row), "outside"])
    given = {name for row in confusion.values() for name in row}
    columns = [name for name in named if name in given] + sorted(given - set(named))
    counts = np.array([[confusion[row].get(name, 0) for name in columns] for row in rows])
    size = (12.5, 0.24 * len(rows) + 2.4)
    with saved(output, ncols=2, figsize=size, width_ratios=(2.2, 1.0)) as (_, (matrix, shares)):
        matrix.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        for (i, j), count in np.ndenumerate(counts):
            if count:
                dark = count > 0.5 * counts[i].sum()
                matrix.text(j, i, count, ha="center", va="center", fontsize=7, color="white" if dark else "black")
        matrix.set_yticks(range(len(rows)), [_told(row) for row in rows], fontsize=7)
        matrix.set_xticks(range(len(columns)), [_told(name) for name in columns], fontsize=7, rotation=60, ha="right")
        matrix.set_ylabel("hidden")
        matrix.set_xlabel("named first")
        matrix.spines[:].set_visible(False)
        entries = [(key, found["totals"][key]) for key in SHARES if found["totals"][key]["trials"]]
        for height, (key, total) in enumerate(reversed(entries)):
            words, low, high = SHARES[key]
            shares.barh(height, high - low, left=low, height=0.75, color=MUTED, alpha=0.35, lw=1 if high == low else 0)
            shares.plot([total["low"], total["high"]], [height, height], color=SIMULATED, lw=2)
            shares.plot(total["share"], height, "o", color=SIMULATED)
            shares.text(0.5, height + 0.4, f"{words} ({total['trials']})", fontsize=7, ha="center")
        shares.set_yticks([])
        shares.set_xlim(-0.03, 1.03)
        shares.set_ylim(-0.6, len(entries) - 0.2)
        shares.set_xlabel("share, 95 % interval; grey: wanted; (trials)")


def _told(name: str) -> str:
    return name.replace("outside:", "outside: ").replace("+", " + ").replace("_", " ")
