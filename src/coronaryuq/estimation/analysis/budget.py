"""Variance against budget, and the cost of target intervals; needs no torch, whose import takes longer than they do."""

from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.typed import plain
from coronaryuq.estimation.estimators.formulas import additional_budget, optimal_variance
from coronaryuq.estimation.results import NUMERICAL, Budget, Curve, RowBudget, RowReport, TargetPlan, read_estimates
from coronaryuq.estimation.runs.gather import measured_cost_ratio
from coronaryuq.estimation.settings import Settings

POINTS = 60
"""Of a budget curve."""
CHAIN_PART = 0.25
"""Largest part of a planned variance that the posterior's chain may have: emulated generations cost next to nothing."""


def write_budget(
    estimates_json: str | Path, settings: Settings, out_json: str | Path, failures_json: str | Path | None = None
) -> None:
    """Write the curves of both budget figures and the plan for target intervals (`budget.json`).

    Parameters
    ----------
    estimates_json
        Estimates of `estimation.stage.estimate`.
    settings
        With the declared cost ratio and the target half-widths.
    out_json
        File to write.
    failures_json
        Its `cost` (CPU seconds) gives the cost of a 0D run in 3D runs, if known; otherwise the settings do.

    Raises
    ------
    InputError
        If `settings.target_half_width` names a row that does not exist.
    """
    rows = read_estimates(estimates_json).rows
    ratio = (measured_cost_ratio(failures_json) if failures_json else None) or settings.cost_ratio
    check_targets(settings, [row.row for row in rows])
    write_json(out_json, plain(Budget(curves(rows, ratio), plan(rows, settings.target_half_width, ratio))))


def check_targets(settings: Settings, rows: list[str]) -> None:
    """Raise `InputError` for a target half-width of a row that does not exist."""
    for name in settings.target_half_width:
        if name not in rows:
            raise InputError(
                "estimation.target_half_width",
                name,
                settings.target_half_width[name],
                f"no such row; available: {', '.join(rows)}",
            )


def curves(rows: list[RowReport], cost_ratio: float) -> list[RowBudget]:
    """Return the curves of both budget figures for every row and estimator.

    `optimal_variance`: under the optimal allocation, against a budget of 1 to 10^5 3D runs. `additional_cost`: extra
    cost in 3D runs against the target variance over the present one, 1 down to 0.001. Correlations: original for MFMC;
    held out for MFMC-AE and crossfit-GP, and for MFMC-AE in-sample too, as the paper has it.
    """
    budgets, factors = np.geomspace(1, 1e5, POINTS), np.geomspace(1, 1e-3, POINTS)
    return [_row_budget(row, cost_ratio, budgets, factors) for row in rows]


def _row_budget(row: RowReport, cost_ratio: float, budgets: np.ndarray, factors: np.ndarray) -> RowBudget:
    spread, n_3d = row.variance_3d, row.estimators["MC"].n_3d
    n_0d = n_3d + row.n_propagation
    rho = {"MC": 0.0, "MFMC": row.paper.rho_original, "crossfit-GP": row.estimators["crossfit-GP"].rho_held_out}
    autoencoder = row.estimators.get("MFMC-AE")
    if autoencoder is not None and autoencoder.rho_in_sample is not None:
        rho |= {"MFMC-AE": autoencoder.rho_held_out, "MFMC-AE in-sample": autoencoder.rho_in_sample}
    found = {}
    for name, r in rho.items():
        now = spread / n_3d * (1 - (1 - n_3d / n_0d) * r**2)
        optimal = [optimal_variance(spread, b, cost_ratio, r) for b in budgets]
        extra = [additional_budget(spread, r, n_3d, n_0d, cost_ratio, f * now)[0] for f in factors]
        found[name] = Curve(r, now, optimal, extra)
    return RowBudget(row.row, row.label, cost_ratio, n_3d, n_0d, budgets.tolist(), factors.tolist(), found)


def plan(rows: list[RowReport], half_widths: dict[str, float], cost_ratio: float) -> list[TargetPlan]:
    """Return the runs that each row still needs for its target half-width, with its recommended estimator.

    Counts are rounded up; `cost` is in 3D runs; `cost_of_half` is what half the target width would cost from here.
    The present correlation is assumed: a control variate fitted on more runs only gets better, so for it these are
    upper bounds on average.
    """
    return [_row_plan(row, half_widths[row.row], cost_ratio) for row in rows if row.row in half_widths]


def _row_plan(row: RowReport, width: float, cost_ratio: float) -> TargetPlan:
    estimate = row.recommended_report
    half = estimate.calibrated.half_width
    n_3d, n_0d = estimate.n_3d, estimate.n_3d + row.n_propagation
    variance = estimate.variance
    residual, explained = variance["runs_3d"] * n_3d, variance["propagation"] * n_0d
    numerical = sum(variance.get(source, 0.0) for source in NUMERICAL)
    total = residual + explained
    rho = float(np.sqrt(explained / total)) if total > 0 else 0.0

    def needed(width: float) -> tuple[float, float, float, float]:
        # No run makes up for a coarse mesh, or for a chain that is too short: above its part of the variance it has to
        # be longer.
        wanted = max(estimate.std**2 * (width / half) ** 2 - numerical, 1e-6 * estimate.std**2)
        longer = max(1.0, variance["chain"] / (CHAIN_PART * wanted))
        left = wanted - variance["chain"] / longer
        return *additional_budget(total, rho, n_3d, n_0d, cost_ratio, left), longer

    cost, more_3d, more_0d, longer = needed(width)
    of_half = needed(width / 2)[0]
    return TargetPlan(row.row, width, half, int(np.ceil(more_3d)), int(np.ceil(more_0d)), cost, of_half, longer)
