"""Convergence with the number of 3D runs, variance against budget, and the cost of target intervals."""

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.formulas import additional_budget, correlation, optimal_variance
from coronaryuq.estimation.results import NUMERICAL, Convergence, Curve, RowBudget, RowReport, TargetPlan
from coronaryuq.estimation.runs.table import Row, Runs, pair
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae, selector
from coronaryuq.estimation.surrogates.control_variates import Seen
from coronaryuq.estimation.surrogates.emulator import Emulator, informative
from coronaryuq.estimation.training import train_on

POINTS = 60
"""Of a budget curve."""
CHAIN_PART = 0.25
"""Largest part of a planned variance that the posterior's chain may have: emulated generations cost next to nothing."""


def convergence(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> list[Convergence]:
    """Study subsamples of the pilot, without replacement: one entry per row and size, one list item per trial.

    `rho_original` and `mean_mc` have `settings.convergence_subsamples` values; `rho_ae_in_sample`, `rho_ae_held_out`
    and `rho_crossfit_gp_held_out` the first `settings.convergence_subsamples_fitted` of the same subsamples. Held out
    means: on the pilot runs that the subsample left out. The 0D model at resampled inputs is an emulator of all pilot
    0D runs.
    """
    entries = []
    emulator = Emulator(runs.coordinates(runs.theta), runs.q[list(dict.fromkeys(row.column_0d for row in rows))])
    for size in [s for s in settings.convergence_sizes if s <= len(runs) - 20]:
        subsets = [
            np.sort(generator(seed, "estimation", "convergence", size, trial).permutation(len(runs))[:size])
            for trial in range(settings.convergence_subsamples)
        ]
        fitted = subsets[: settings.convergence_subsamples_fitted]
        networks = train_on(runs, rows, fitted, settings, seed) if settings.autoencoder and fitted else None
        for row in rows:
            y, q = pair(runs, row)
            in_sample, held_out = None, None
            if networks is not None:
                pairs = [_ae_correlations(networks, runs, row, t, s, emulator, settings) for t, s in enumerate(fitted)]
                in_sample, held_out = (list(values) for values in zip(*pairs, strict=True))
            entries.append(Convergence(
                row=row.name, label=row.label, n_3d=size,
                rho_original=[correlation(y[s], q[s]) for s in subsets],
                mean_mc=[float(y[s].mean()) for s in subsets],
                rho_crossfit_gp_held_out=[_crossfit_gp_held_out(runs, row, s) for s in fitted],
                rho_ae_in_sample=in_sample, rho_ae_held_out=held_out,
            ))  # fmt: skip
    return entries


def budget(rows: list[RowReport], cost_ratio: float) -> list[RowBudget]:
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
    curves = {}
    for name, r in rho.items():
        now = spread / n_3d * (1 - (1 - n_3d / n_0d) * r**2)
        optimal = [optimal_variance(spread, b, cost_ratio, r) for b in budgets]
        extra = [additional_budget(spread, r, n_3d, n_0d, cost_ratio, f * now)[0] for f in factors]
        curves[name] = Curve(r, now, optimal, extra)
    return RowBudget(row.row, row.label, cost_ratio, n_3d, n_0d, budgets.tolist(), factors.tolist(), curves)


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


def _ae_correlations(
    networks: mfmc_ae.Networks, runs: Runs, row: Row, trial: int, subset: np.ndarray, emulator: Emulator,
    settings: Settings,
) -> tuple[float, float]:  # fmt: skip
    """|ρ| of one trial's network on its own runs and on the others."""
    fit = mfmc_ae.IN_SAMPLE if trial == networks.folds else trial
    y, _ = pair(runs, row)
    places = mfmc_ae.nodes(networks, row.name, fit, settings.curve_nodes)
    theta = mfmc_ae.resampled(networks, row.name, fit, places)
    outputs = emulator.predict(runs.coordinates(theta))[row.column_0d]
    follows = mfmc_ae.along_curve(places, outputs, mfmc_ae.latent(networks, row.name, fit, runs.theta))
    others = np.setdiff1d(np.arange(len(runs)), subset)
    inside = correlation(y[subset], follows[subset])
    return abs(inside), float(np.sign(inside) * correlation(y[others], follows[others]))


def _crossfit_gp_held_out(runs: Runs, row: Row, subset: np.ndarray) -> float:
    y, q = pair(runs, row)
    seen = Seen(runs.coordinates(runs.theta), q, runs.q[informative(runs.q, [row.column_0d])].to_numpy(float))
    others = np.setdiff1d(np.arange(len(runs)), subset)
    return correlation(y[others], selector.choose(seen[subset], y[subset]).predict(seen[others]))
