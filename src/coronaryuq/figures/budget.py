"""Convergence with the number of 3D runs (Fig. 6), and variance and cost against the budget (Fig. 7)."""

import numpy as np

from coronaryuq.estimation.results import read_budget, read_convergence
from coronaryuq.figures.style import ESTIMATORS, MUTED, Output, colour, limit_line, saved

LEAST_COST = 1e-2
"""Smallest cost that is drawn, in 3D runs; lower ones would only extend the logarithmic axis."""
SERIES = (
    ("rho_original", "3D against 0D, same θ", MUTED),
    ("rho_ae_in_sample", "MFMC-AE, in-sample", "#E2B5CB"),
    ("rho_ae_held_out", "MFMC-AE, held out", ESTIMATORS["MFMC-AE"]),
    ("rho_crossfit_gp_held_out", "crossfit-GP, held out", ESTIMATORS["crossfit-GP"]),
)


def convergence(convergence: str, output: Output) -> None:
    """Draw correlations and the Monte Carlo mean of a quantity over random subsamples, a dot each (Fig. 6)."""
    entries = read_convergence(convergence)
    quantity = entries[0].label.split(", ")[0] if entries else ""
    rows = list(dict.fromkeys(entry.row for entry in entries))
    columns = max(len(rows), 1)
    known = [abs(value) for entry in entries for key, _, _ in SERIES for value in getattr(entry, key) or []]
    lowest = max(0.0, np.floor(10 * min(known, default=0.0) - 0.2) / 10)
    with saved(output, nrows=2, ncols=columns, figsize=(3.4 * columns, 3.9), squeeze=False, sharex="col") as (
        figure,
        axes,
    ):
        for column, row in enumerate(rows):
            of_row = [entry for entry in entries if entry.row == row]
            sizes = [entry.n_3d for entry in of_row]
            step = min(np.diff(sizes), default=max(sizes))
            for k, (key, label, ink) in enumerate(SERIES):
                for entry in of_row:
                    values = np.abs(getattr(entry, key) or [])
                    place = entry.n_3d + (k - 1.5) * 0.16 * step
                    axes[0][column].plot(np.full(len(values), place), values, ".", ms=3, alpha=0.5, color=ink)
                    if len(values):
                        axes[0][column].plot(place, np.mean(values), "_", ms=9, mew=2, color=ink)
                if any(getattr(entry, key) for entry in of_row):
                    axes[0][column].plot([], [], "o", ms=4, color=ink, label=label)
            for entry in of_row:
                means = entry.mean_mc
                axes[1][column].plot(np.full(len(means), entry.n_3d), means, ".", ms=3, alpha=0.5, color="black")
            if quantity == "FFR":
                limit_line(axes[1][column], along="y")
            axes[0][column].set_ylim(lowest, 1.03 - 0.03 * lowest)
            axes[0][column].tick_params(bottom=False)  # sizes are below the lower panels
            branch = of_row[0].label.split(", ")[-1]
            axes[0][column].set_title(branch, color=colour(branch))
            axes[1][column].set_xlabel("3D runs")
        axes[0][0].set_ylabel("correlation |ρ|")
        axes[1][0].set_ylabel(f"Monte Carlo mean\nof {quantity}")
        if rows:
            figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8)


def budget(budget: str, output: Output) -> None:
    """Draw the optimal variance of FFR against the budget, and the cost of a smaller variance (Fig. 7)."""
    _budget(budget, output, ("FFR, FFR", "FFR"))


def osi_budget(budget: str, output: Output) -> None:
    """Draw the same of patch-max OSI, or of maximum OSI, the paper's example, where that is not estimated."""
    _budget(budget, output, ("patch-max OSI", "max OSI"))


def _budget(budget: str, output: Output, candidates: tuple[str, ...]) -> None:
    """Draw the rows of the first of some quantities that was estimated."""
    every = read_budget(budget).budget
    by_quantity = [[row for row in every if row.label.startswith(f"{name}, ")] for name in candidates]
    rows = next(filter(None, by_quantity), [])
    columns = max(len(rows), 1)
    with saved(output, nrows=2, ncols=columns, figsize=(3.4 * columns, 3.9), squeeze=False) as (figure, axes):
        for column, row in enumerate(rows):
            for name, curve in row.estimators.items():
                base = name.removesuffix(" in-sample")
                look = {"color": ESTIMATORS[base], "ls": "-" if base == name else ":", "lw": 1.4, "label": name}
                axes[0][column].loglog(row.budget_3d_runs, curve.optimal_variance, **look)
                cost = np.array(curve.additional_cost, dtype=float)
                reached = np.isfinite(cost) & (cost > LEAST_COST)
                axes[1][column].loglog(np.array(row.variance_factor)[reached], cost[reached], **look)
            branch = row.label.split(", ")[-1]
            axes[0][column].set_title(branch, color=colour(branch))
            axes[0][column].set_xlabel("budget (3D runs)")
            axes[1][column].set_xlabel("variance / current variance")
            axes[1][column].invert_xaxis()
        if rows:
            axes[0][0].set_ylabel(f"optimal variance,\nmean of {rows[0].label.split(', ')[0]}")
            axes[1][0].set_ylabel("additional cost\n(3D runs)")
            figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize=8)
