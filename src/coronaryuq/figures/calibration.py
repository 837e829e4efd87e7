"""Cardiac function: the tuned loop compared with its targets (paper, Fig. A.1)."""

import numpy as np

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import MEASURED, MUTED, SIMULATED, Output, saved

NARROW, WIDEST = 5.0, 60.0
"""Half widths in per cent: of the grey band, and the maximum of the axis."""


def cardiac_function(fit: str, output: Output) -> None:
    """Draw the difference of the tuned model from each target in per cent, and both values; arrowhead: beyond the axis.

    Clinical targets of this patient come first, those from the literature (flow waveforms, valve times) below.
    """
    table = read_csv(fit, columns=("description", "unit", "measured", "simulated", "tuned", "clinical"))
    table = table[table["tuned"]].sort_values("clinical", ascending=False, kind="stable")
    off = 100 * (table["simulated"] / table["measured"].where(table["measured"] != 0) - 1)
    wide = float(np.clip(1.2 * off.abs().max(), 2 * NARROW, WIDEST))
    y = np.arange(len(table))[::-1]
    with saved(output, figsize=(7.6, 0.21 * len(table) + 1.0)) as (_, axis):
        axis.axvspan(-NARROW, NARROW, color=MUTED, alpha=0.18, lw=0)
        axis.axvline(0, color=MEASURED, lw=0.8)
        clinical = table["clinical"].to_numpy(bool)
        shown = np.clip(off, -wide, wide)
        for chosen, colour, label in (
            (clinical, SIMULATED, "measured in this patient"),
            (~clinical, MUTED, "from the literature"),
        ):
            axis.hlines(y[chosen], 0, shown[chosen], color=colour, lw=1)
            within = chosen & (off.abs() <= wide).to_numpy()
            axis.plot(shown[within], y[within], "o", color=colour, ms=4, label=label)
            for beyond, marker in ((off > wide, ">"), (off < -wide, "<")):
                there = chosen & beyond.to_numpy()
                axis.plot(shown[there], y[there], marker, color=colour, ms=6)
        for place, (_, row) in zip(y, table.iterrows(), strict=True):
            unit = "" if row["unit"] == "1" else f" {row['unit']}"
            axis.text(
                1.01, place, f"{row['measured']:.3g} → {row['simulated']:.3g}{unit}", va="center", fontsize=7.5,
                transform=axis.get_yaxis_transform(),
            )  # fmt: skip
        axis.set_yticks(y, table["description"], fontsize=7.5)
        axis.set_xlim(-1.03 * wide, 1.03 * wide)
        axis.set_xlabel("difference from target (%)")
        axis.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, fontsize=7.5)
        axis.spines["left"].set_visible(False)
        axis.tick_params(axis="y", length=0)
