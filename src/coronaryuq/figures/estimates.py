"""Pairs of outputs in the shared space (Fig. 3), and the intervals of all estimators (Figs. 4, 5)."""

import numpy as np
from matplotlib.ticker import MaxNLocator

from coronaryuq.core.io.tables import read_csv
from coronaryuq.estimation.results import RowReport, read_estimates
from coronaryuq.figures.style import ESTIMATORS, MUTED, SIMULATED, colour, saved

UNITS = {"patch-min TAWSS": " (dyn/cm²)", "min TAWSS": " (dyn/cm²)"}
SHEAR = ("patch-min TAWSS", "low-shear area", "patch-max OSI", "max OSI", "min TAWSS")
"""Quantities of wall shear, extremes last."""
EXTREMES = ("max OSI", "min TAWSS")

SCATTERED = (("q", MUTED, "same θ"), ("q_resampled", SIMULATED, "resampled, held out, folds aligned"))

STYLES = (("chebyshev_99", (0, (3, 2)), 0.9), ("chebyshev_95", "-", 1.2), ("calibrated", "-", 3.5))
"""Interval, line style, line width."""
WARNING = "#B3261E"


def osi_scatter(pairs: str, output: str) -> None:
    """Draw 3D maximum OSI against 0D mean flow, at the same θ and resampled through the shared space, by branch."""
    table = read_csv(pairs, columns=("row", "label", "y", "q", "q_resampled"))
    rows = list(table["row"][table["label"].str.startswith("max OSI")].unique())
    with saved(output, ncols=max(len(rows), 1), figsize=(3.2 * max(len(rows), 1), 3.6), squeeze=False) as (_, axes):
        for axis, row in zip(axes[0], rows, strict=False):
            part = table[table["row"] == row]
            for column, ink, word in SCATTERED:
                seen = part[column].notna()
                if not seen.any():
                    continue
                rho = np.corrcoef(part["y"][seen], part[column][seen])[0, 1]
                axis.plot(part[column], part["y"], "o", ms=3, alpha=0.7, color=ink, label=f"{word}: ρ = {rho:.3f}")
            axis.set_xlabel("0D mean outlet flow (mL/s)")
            axis.set_title(part["label"].iloc[0].split(", ")[-1], fontsize=9)
            axis.legend(fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, -0.2))
        axes[0][0].set_ylabel("3D maximum OSI")


def intervals_wss(estimates: str, output: str) -> None:
    """Draw means and intervals of wall shear by all estimators; of the published runs, Fig. 4."""
    _intervals(estimates, output, tuple(f"{quantity}, mean flow" for quantity in SHEAR))


def intervals_ffr(estimates: str, output: str) -> None:
    """Draw means and intervals of FFR, estimated with 0D FFR and with 0D mean flow (Fig. 5)."""
    _intervals(estimates, output, ("FFR, FFR", "FFR, mean flow"))


def _intervals(estimates: str, output: str, kinds: tuple[str, ...]) -> None:
    every = read_estimates(estimates).rows
    rows = [[row for row in every if row.label.startswith(f"{kind}, ")] for kind in kinds]
    rows = [line for line in rows if line] or [[]]
    columns = max(1, *(len(line) for line in rows))
    with saved(output, nrows=len(rows), ncols=columns, figsize=(3.3 * columns, 2.5 * len(rows)), squeeze=False) as (
        figure,
        axes,
    ):
        for line, axes_of_line in zip(rows, axes, strict=True):
            for row, axis in zip(line, axes_of_line, strict=False):
                _draw_row(axis, row)
            for axis in axes_of_line[len(line) :]:
                axis.set_axis_off()
        figure.supxlabel("solid: Chebyshev 95 %, dashed: Chebyshev 99 %, thick: calibrated 95 %", fontsize=8)


def _draw_row(axis, row: RowReport) -> None:
    quantity, paired, branch = row.label.split(", ", 2)
    extreme = ", extreme" if quantity in EXTREMES else ""
    title = f"{branch}: {quantity}{UNITS.get(quantity, '')}{extreme}\nwith 0D {paired}"
    axis.set_title(title, fontsize=8, color=colour(branch))
    if row.variance_3d == 0:
        of_all = row.estimators["MC"]
        axis.text(0.5, 0.5, f"{of_all.mean:g} in all {of_all.n_3d} runs", ha="center", transform=axis.transAxes)
        axis.set_axis_off()
        return
    names = list(row.estimators)
    for place, name in enumerate(names):
        value, ink = row.estimators[name], ESTIMATORS[name]
        y = len(names) - 1 - place
        for key, style, width in STYLES:
            interval = getattr(value, key)
            axis.plot([interval.low, interval.high], [y, y], ls=style, lw=width, color=ink, alpha=0.85)
        axis.plot(value.mean, y, "o", color="white", mec=ink, ms=5, zorder=5)
        if value.warnings:
            axis.annotate("!", (value.mean, y), xytext=(0, 5), textcoords="offset points", ha="center", color=WARNING)
    axis.set_yticks(range(len(names))[::-1], names)
    axis.set_ylim(-0.6, len(names) - 0.4)
    axis.tick_params(labelsize=7)
    axis.xaxis.set_major_locator(MaxNLocator(5))
