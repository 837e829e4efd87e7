"""Cardiac function: the tuned loop compared with its targets (paper, Fig. A.1)."""

import numpy as np
import pandas as pd

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import MEASURED, MUTED, SIMULATED, Output, saved

NARROW, WIDEST = 5.0, 60.0
"""Half widths in per cent: of the grey band, and the maximum of the axis."""
KINDS = ((True, SIMULATED, "measured in this patient"), (False, MUTED, "from the literature"))
"""Whether clinical, colour and name of the kinds of targets."""


def cardiac_function(fit: str, output: Output) -> None:
    """Draw the difference of the tuned model from each target in per cent, and both values; arrowhead: beyond the axis.

    Clinical targets of this patient come first, those from the literature (flow waveforms, valve times) after them, in
    two columns.
    """
    table = read_csv(fit, columns=("description", "unit", "measured", "simulated", "tuned", "clinical"))
    table = table[table["tuned"]].sort_values("clinical", ascending=False, kind="stable")
    table["off"] = 100 * (table["simulated"] / table["measured"].where(table["measured"] != 0) - 1)
    wide = float(np.clip(1.2 * table["off"].abs().max(), 2 * NARROW, WIDEST))
    rows = -(-len(table) // 2)
    with saved(output, ncols=2, figsize=(10.0, 0.21 * rows + 0.9)) as (figure, axes):
        for axis, part in zip(axes, (table[:rows], table[rows:]), strict=True):
            _draw_targets(axis, part, wide, rows)
        handles = [axes[0].plot([], [], "o", color=ink, ms=4, label=label)[0] for _, ink, label in KINDS]
        figure.legend(handles=handles, loc="outside upper center", ncols=2, fontsize=8)


def _draw_targets(axis, part: pd.DataFrame, wide: float, rows: int) -> None:
    """Draw some targets from the top down on an axis with room for a number of rows."""
    y = rows - 1 - np.arange(len(part))
    off, clinical = part["off"], part["clinical"].to_numpy(bool)
    axis.axvspan(-NARROW, NARROW, color=MUTED, alpha=0.18, lw=0)
    axis.axvline(0, color=MEASURED, lw=0.8)
    shown = np.clip(off, -wide, wide)
    for kind, colour, _ in KINDS:
        chosen = clinical == kind
        axis.hlines(y[chosen], 0, shown[chosen], color=colour, lw=1)
        within = chosen & (off.abs() <= wide).to_numpy()
        axis.plot(shown[within], y[within], "o", color=colour, ms=4)
        for beyond, marker in ((off > wide, ">"), (off < -wide, "<")):
            there = chosen & beyond.to_numpy()
            axis.plot(shown[there], y[there], marker, color=colour, ms=6)
    for place, row in zip(y, part.to_dict("records"), strict=True):
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        axis.text(
            1.01, place, f"{row['measured']:.3g} → {row['simulated']:.3g}{unit}", va="center", fontsize=7.5,
            transform=axis.get_yaxis_transform(),
        )  # fmt: skip
    axis.set_yticks(y, part["description"], fontsize=7.5)
    axis.set_xlim(-1.03 * wide, 1.03 * wide)
    axis.set_ylim(-0.7, rows - 0.3)
    axis.set_xlabel("difference from target (%)")
    axis.spines["left"].set_visible(False)
    axis.tick_params(axis="y", length=0)
