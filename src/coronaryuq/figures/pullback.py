"""Pullbacks of a pressure wire: readings, the model before and after the search, and where its effects act."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.discrepancy import AFTER, BEFORE, MEASURED, after_label, words_of
from coronaryuq.figures.style import MUTED, saved
from coronaryuq.figures.units_shown import shown_in

SIGNIFICANT = 0.8
"""FFR at or below which a stenosis is treated (Tonino et al., N. Engl. J. Med. 360 (2009) 213)."""
COLUMNS = (
    *("condition", "quantity", "location", "statistic", "distance_mm", "measured", "sd", "recalibrated", "repaired"),
    *("vessel", "acting", "named"),
)


def pullback(
    table: str | Path, output: str | Path, case: str | Path | None = None, tree: str | Path | None = None
) -> None:
    """Draw each pullback along its path: readings with error bars, the model before and after, effects shaded."""
    frame, in_words = read_csv(table, COLUMNS, words=("acting",)), words_of(case, tree)
    groups = list(frame.groupby(["location", "condition", "quantity"], sort=False))
    with saved(output, nrows=max(1, len(groups)), figsize=(7.0, 3.4 * max(1, len(groups))), squeeze=False) as (
        canvas,
        axes,
    ):
        if not groups:
            axes.flat[0].text(0.5, 0.5, "no pullback was measured", ha="center")
            axes.flat[0].set_axis_off()
        for axis, ((location, condition, quantity), part) in zip(axes.flat, groups, strict=False):
            scale, unit = shown_in(quantity)
            x = part.distance_mm.to_numpy()
            _shade(axis, x, part)
            style = {"fmt": ".", "ms": 3, "lw": 0.6, "color": MEASURED, "zorder": 2}
            axis.errorbar(x, part.measured / scale, part.sd / scale, label="measured ± sd", **style)
            axis.plot(x, part.recalibrated / scale, color=BEFORE, lw=1.4, label="recalibrated", zorder=3)
            axis.plot(x, part.repaired / scale, color=AFTER, lw=1.4, label=after_label(frame), zorder=3)
            if quantity.endswith("ratio"):
                axis.axhline(SIGNIFICANT, color=MUTED, ls="--", lw=1)
                axis.annotate(f"{SIGNIFICANT:.2f}", (1.0, SIGNIFICANT), (3, 0), ("axes fraction", "data"),
                              "offset points", fontsize=6, color=MUTED, va="center")  # fmt: skip
            _name_vessels(axis, x, part, in_words)
            statistic = part.statistic.iloc[0]
            axis.set_xlabel("distance from the start of the path (mm)")
            axis.set_ylabel("Pd/Pa" if quantity.endswith("ratio") else f"{statistic} pressure ({unit})")
            axis.set_title(f"pullback along {in_words(location)} under {condition}", fontsize=8, pad=14)
        canvas.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)


def _shade(axis, x: np.ndarray, part: pd.DataFrame) -> None:
    """Shade where each effect acts, and name it."""
    half = 0.5 * float(np.median(np.diff(x))) if len(x) > 1 else 0.5
    acting = [str(words).split("; ") if isinstance(words, str) and words else [] for words in part.acting]
    names = list(dict.fromkeys(name for own in acting for name in own))
    for number, name in enumerate(names):
        inside = x[[name in own for own in acting]]
        axis.axvspan(inside.min() - half, inside.max() + half, color=AFTER, alpha=0.15, lw=0, zorder=0)
        where = 0.5 * (inside.min() + inside.max()), 0.97 - 0.06 * number
        words = name.replace("_", " ")
        style = {"fontsize": 6, "color": AFTER, "ha": "center", "va": "top"}
        axis.text(*where, words, transform=axis.get_xaxis_transform(), **style)


def _name_vessels(axis, x: np.ndarray, part: pd.DataFrame, in_words: Callable[[str], Any]) -> None:
    """Mark where one vessel of the path ends and the next begins, with their names above the axes."""
    vessels = part.vessel.to_numpy()
    for vessel in dict.fromkeys(vessels.tolist()):
        own = np.flatnonzero(vessels == vessel)
        if own[0] > 0:
            axis.axvline(0.5 * (x[own[0] - 1] + x[own[0]]), color=MUTED, lw=0.6, ls=":", zorder=1)
        where = 0.5 * (x[own[0]] + x[own[-1]]), 1.01
        axis.text(*where, in_words(vessel), transform=axis.get_xaxis_transform(), fontsize=6, ha="center", va="bottom")
