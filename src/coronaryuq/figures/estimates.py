"""Pairs of outputs in the shared space (Fig. 3), and the intervals of all estimators (Figs. 4, 5)."""

import numpy as np
from matplotlib.ticker import MaxNLocator

from coronaryuq.core.io.tables import read_csv
from coronaryuq.estimation.results import RowReport, read_estimates
from coronaryuq.figures.style import ESTIMATORS, FFR_LIMIT, MUTED, SIMULATED, Output, colour, limit_line, saved

UNITS = {"patch-min TAWSS": "dyn/cm²", "min TAWSS": "dyn/cm²", "low-shear area": "%"}
SCALES = {"low-shear area": 100.0}
SHEAR = ("patch-min TAWSS", "low-shear area", "patch-max OSI")
"""Averages of wall shear over a part of the wall."""
EXTREMES = ("max OSI", "min TAWSS")
"""Of wall shear, at single points."""

SCATTERED = (("q", MUTED, "same input"), ("q_resampled", SIMULATED, "shared space, held out"))

STYLES = (("chebyshev_95", 1.2), ("calibrated", 4.0))
"""Interval and line width."""
WARNING = "#B3261E"


def scatter(pairs: str, output: Output) -> None:
    """Draw 3D against 0D FFR, at the same θ and resampled through the shared space, by artery."""
    _scatter(pairs, output, "FFR, FFR", ("0D FFR", "3D FFR"))


def osi_scatter(pairs: str, output: Output) -> None:
    """Draw 3D maximum OSI against 0D mean flow, likewise; of the published runs, Fig. 3."""
    _scatter(pairs, output, "max OSI", ("0D mean outlet flow (mL/s)", "3D maximum OSI"))


def _scatter(pairs: str, output: Output, quantity: str, axes_labels: tuple[str, str]) -> None:
    table = read_csv(pairs, columns=("row", "label", "y", "q", "q_resampled"))
    rows = list(table["row"][table["label"].str.startswith(quantity)].unique())
    with saved(output, ncols=max(len(rows), 1), figsize=(3.2 * max(len(rows), 1), 3.6), squeeze=False) as (_, axes):
        for axis, row in zip(axes[0], rows, strict=False):
            part = table[table["row"] == row]
            for column, ink, word in SCATTERED:
                seen = part[column].notna()
                if not seen.any():
                    continue
                rho = np.corrcoef(part["y"][seen], part[column][seen])[0, 1]
                axis.plot(part[column], part["y"], "o", ms=3, alpha=0.7, color=ink, label=f"{word}: ρ = {rho:.3f}")
            if quantity.startswith("FFR"):
                limit_line(axis, along="y")
            axis.set_xlabel(axes_labels[0])
            branch = part["label"].iloc[0].split(", ")[-1]
            axis.set_title(branch, color=colour(branch))
            axis.legend(fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, -0.2))
        axes[0][0].set_ylabel(axes_labels[1])


def intervals_wss(estimates: str, output: Output) -> None:
    """Draw means and intervals of averages of wall shear by all estimators."""
    _intervals(estimates, output, tuple(f"{quantity}, mean flow" for quantity in SHEAR))


def intervals_extremes(estimates: str, output: Output) -> None:
    """Draw the same of the extremes of wall shear; of the published runs, Fig. 4."""
    _intervals(estimates, output, tuple(f"{quantity}, mean flow" for quantity in EXTREMES))


def intervals_ffr(estimates: str, output: Output) -> None:
    """Draw means and intervals of FFR, estimated with 0D FFR and with 0D mean flow (Fig. 5)."""
    _intervals(estimates, output, ("FFR, FFR", "FFR, mean flow"))


def _intervals(estimates: str, output: Output, kinds: tuple[str, ...]) -> None:
    every = read_estimates(estimates).rows
    rows = [[row for row in every if row.label.startswith(f"{kind}, ")] for kind in kinds]
    rows = [line for line in rows if line] or [[]]
    columns = max(1, *(len(line) for line in rows))
    estimators = max((len(row.estimators) for line in rows for row in line), default=1)
    titles = [[_title(row) for row in line] for line in rows]
    titled = [k == 0 or titles[k] != titles[k - 1] for k in range(len(rows))]
    height = len(rows) * (0.48 + 0.16 * max(estimators, 3)) + 0.25 * sum(titled) + 0.2
    with saved(output, nrows=len(rows), ncols=columns, figsize=(3.3 * columns, height), squeeze=False) as (
        figure,
        axes,
    ):
        for line, axes_of_line, names in zip(rows, axes, titled, strict=True):
            for row, axis in zip(line, axes_of_line, strict=False):
                _draw_row(axis, row)
                if names:
                    axis.set_title(_title(row), color=colour(row.label.split(", ")[-1]), fontsize=8.5)
            for axis in axes_of_line[len(line) :]:
                axis.remove()
        figure.supxlabel("thick: calibrated 95 %; thin: Chebyshev 95 %; !: estimate with a warning", fontsize=8)


def _title(row: RowReport) -> str:
    _, paired, branch = row.label.split(", ", 2)
    return f"{branch}, with 0D {paired}"


def _draw_row(axis, row: RowReport) -> None:
    quantity = row.label.split(", ")[0]
    scale = SCALES.get(quantity, 1.0)
    unit = UNITS.get(quantity, "")
    axis.set_xlabel(f"{quantity} ({unit})" if unit else quantity, fontsize=8.5)
    if row.variance_3d == 0:
        of_all = row.estimators["MC"]
        axis.text(0.5, 0.5, f"{of_all.mean * scale:g} in all {of_all.n_3d} runs", ha="center", transform=axis.transAxes)
        axis.set(xticks=[], yticks=[])
        return
    names = list(row.estimators)
    for place, name in enumerate(names):
        value, ink = row.estimators[name], ESTIMATORS[name]
        y = len(names) - 1 - place
        for key, width in STYLES:
            interval = getattr(value, key)
            ends = [interval.low * scale, interval.high * scale]
            axis.plot(ends, [y, y], lw=width, color=ink, alpha=0.85, solid_capstyle="butt")
        axis.plot(value.mean * scale, y, "o", color="white", mec=ink, ms=5, zorder=5)
        if row.warnings_of(name):
            beside = {"xycoords": ("axes fraction", "data"), "xytext": (4, 0), "textcoords": "offset points"}
            axis.annotate("!", (1.0, y), **beside, ha="center", va="center", color=WARNING, fontweight="bold")
    if quantity == "FFR":
        limit_line(axis)
        low, high = axis.get_xlim()
        axis.set_xlim(min(low, FFR_LIMIT - 0.01), max(high, FFR_LIMIT + 0.01))
    axis.set_yticks(range(len(names))[::-1], names)
    axis.set_ylim(-0.6, len(names) - 0.4)
    axis.tick_params(labelsize=7.5)
    axis.xaxis.set_major_locator(MaxNLocator(4))
