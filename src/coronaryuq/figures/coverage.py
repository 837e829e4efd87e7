"""Calibration of the intervals in the benchmark: reported over empirical standard error, and coverage."""

import numpy as np
from matplotlib.ticker import FixedLocator, NullLocator

from coronaryuq.core.io.tables import read_csv
from coronaryuq.figures.style import ESTIMATORS, MUTED, saved

RATIO, COVERAGE = (0.85, 1.15), (93, 97)
"""Targets: reported within 15 % of the empirical standard error, and a coverage of 93 to 97 %."""


def coverage(table: str, output: str) -> None:
    """Draw each cell as a dot with its 95 % error; grey: targets. Columns: pilot sizes; lines: problems, quantities."""
    columns = ("problem", "method", "quantity", "n_3d", "trials", "claimed_over_empirical", "coverage_95")
    cells = read_csv(table, columns=(*columns, "coverage_95_low", "coverage_95_high"))
    cells["line"] = cells["problem"] + np.where(cells["quantity"] == "mean", "", ": " + cells["quantity"])
    lines = list(dict.fromkeys(cells["line"]))[::-1]
    sizes = sorted(cells["n_3d"].unique())
    ratio_all = cells["claimed_over_empirical"]
    methods = [name for name in ESTIMATORS if name in set(cells["method"])]
    height = 1.3 + 0.13 * len(lines) * max(1.0, len(methods) / 2)
    with saved(output, ncols=2 * len(sizes), figsize=(2 + 3.4 * len(sizes), height), squeeze=False, sharey=True) as (
        figure,
        axes,
    ):
        for size, (ratios, shares) in zip(sizes, axes[0].reshape(-1, 2), strict=True):
            ratios.axvspan(*RATIO, color=MUTED, alpha=0.25, lw=0)
            shares.axvspan(*COVERAGE, color=MUTED, alpha=0.25, lw=0)
            ratios.set_yticks(range(len(lines)), lines, fontsize=7)
            ratios.set_ylim(-0.6, len(lines) - 0.4)
            for place, method in enumerate(methods):
                part = cells[(cells["n_3d"] == size) & (cells["method"] == method)]
                y = part["line"].map(lines.index).to_numpy(float) + 0.22 * ((len(methods) - 1) / 2 - place)
                ratio, share = part["claimed_over_empirical"].to_numpy(), part["coverage_95"].to_numpy()
                # The error of the ratio is that of a standard deviation, symmetric on a logarithmic axis.
                factor = np.exp(1.96 / np.sqrt(2 * part["trials"].to_numpy()))
                around = np.abs(part[["coverage_95_low", "coverage_95_high"]].to_numpy().T - share)
                look = {"fmt": "o", "ms": 2.5, "lw": 0.8, "color": ESTIMATORS[method]}
                ratios.errorbar(ratio, y, xerr=[ratio * (1 - 1 / factor), ratio * (factor - 1)], **look, label=method)
                shares.errorbar(100 * share, y, xerr=100 * around, **look)
            ratios.set_xscale("log")
            ratios.xaxis.set_major_locator(FixedLocator((0.25, 0.5, 0.85, 1.15, 2, 4)))
            ratios.xaxis.set_major_formatter("{x:g}")
            ratios.xaxis.set_minor_locator(NullLocator())
            ratios.set_xlim(0.9 * min(0.7, ratio_all.min()), 1.1 * max(1.5, ratio_all.max()))
            ratios.set_title(f"{size} 3D runs", loc="left")
            ratios.set_xlabel("reported / empirical standard error")
            shares.set_xlim(100 * cells["coverage_95_low"].min() - 1, 100.5)
            shares.set_xlabel("coverage of 95 % intervals (%)")
            for axis in (ratios, shares):
                axis.tick_params(axis="x", labelsize=6)
        handles = {
            label: handle for axis in axes[0] for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
        }
        figure.legend(handles.values(), handles, loc="outside upper center", ncols=len(handles), fontsize=8)
