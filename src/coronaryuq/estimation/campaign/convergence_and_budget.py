"""Convergence with the number of 3D runs, what a budget buys, and what a wanted interval still costs."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.campaign import analysis
from coronaryuq.estimation.estimators.montecarlo import additional_budget, correlation, optimal_variance
from coronaryuq.estimation.runs.table import Row, Runs, pair
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae, selector
from coronaryuq.estimation.surrogates.control_variates import Seen
from coronaryuq.estimation.surrogates.emulator import Emulator, informative


def convergence(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> list[dict]:
    """One entry per row and size with one list item per trial: subsamples of the pilot without replacement.

    `rho_original` and `mean_mc` have `settings.trials` values; `rho_ae_in_sample`, `rho_ae_held_out` and
    `rho_best_held_out` the first `settings.trials_fitted` of the same subsamples. Held out means: on the pilot runs
    that the subsample left out. The 0D model at resampled inputs is an emulator of all pilot 0D runs.
    """
    found = []
    emulator = Emulator(np.log(runs.theta), runs.q[list(dict.fromkeys(row.column_0d for row in rows))])
    for size in [s for s in settings.convergence_sizes if s <= len(runs) - 20]:
        subsets = [
            np.sort(generator(seed, "estimation", "convergence", size, trial).permutation(len(runs))[:size])
            for trial in range(settings.trials)
        ]
        fitted = subsets[: settings.trials_fitted]
        networks = _networks(runs, rows, fitted, settings, seed) if settings.autoencoder and fitted else None
        for row in rows:
            y, q = pair(runs, row)
            entry = {
                "row": row.name, "label": row.label, "n_3d": size,
                "rho_original": [correlation(y[s], q[s]) for s in subsets],
                "mean_mc": [float(y[s].mean()) for s in subsets],
                "rho_best_held_out": [_best_held_out(runs, row, s) for s in fitted],
            }  # fmt: skip
            if networks is not None:
                pairs = [_ae_correlations(networks, runs, row, t, s, emulator, settings) for t, s in enumerate(fitted)]
                entry["rho_ae_in_sample"], entry["rho_ae_held_out"] = (list(v) for v in zip(*pairs, strict=True))
            found.append(entry)
    return found


def budget(results: list[dict], cost_ratio: float, points: int = 60) -> list[dict]:
    """Curves of both budget figures for every row and estimator, from the rows of `estimates.json`.

    `optimal`: variance under the optimal allocation against a budget of 1 to 10^5 3D runs. `additional`: extra cost
    in 3D runs against the wanted variance over today's, 1 down to 0.001. Correlations: original for MFMC; held out
    for MFMC-AE and best, and for MFMC-AE in-sample too, as the paper has it.
    """
    found = []
    budgets, factors = np.geomspace(1, 1e5, points), np.geomspace(1, 1e-3, points)
    for result in results:
        made, spread = result["estimators"], result["variance_3d"]
        rho = {"MC": 0.0, "MFMC": result["paper"]["rho_original"], "best": made["best"]["rho_held_out"]}
        if "MFMC-AE" in made:
            rho |= {"MFMC-AE": made["MFMC-AE"]["rho_held_out"], "MFMC-AE in-sample": made["MFMC-AE"]["rho_in_sample"]}
        n_3d, n_0d = made["MC"]["n_3d"], made["MC"]["n_3d"] + result["n_propagation"]
        curves = {}
        for name, r in rho.items():
            now = spread / n_3d * (1 - (1 - n_3d / n_0d) * r**2)
            extra = [additional_budget(spread, r, n_3d, n_0d, cost_ratio, f * now) for f in factors]
            curves[name] = {
                "rho": r, "variance_now": now,
                "optimal_variance": [optimal_variance(spread, b, cost_ratio, r) for b in budgets],
                "additional_cost": [e[0] for e in extra],
            }  # fmt: skip
        found.append({
            "row": result["row"], "label": result["label"], "cost_ratio": cost_ratio, "n_3d": n_3d, "n_0d": n_0d,
            "budget_3d_runs": budgets.tolist(), "variance_factor": factors.tolist(), "estimators": curves,
        })  # fmt: skip
    return found


@dataclass(frozen=True)
class Want:
    """A row's wanted half-width of the calibrated interval, and where it stands."""

    row: str
    wanted: float
    now: float
    more_3d: int
    more_0d: int
    cost: float
    cost_of_half: float


def plan(results: list[dict], wanted: dict[str, float], cost_ratio: float) -> list[Want]:
    """What each row still needs for its wanted half-width, with its recommended estimator at today's correlation.

    Counts are rounded up; `cost` is in 3D runs; `cost_of_half` is what half the wanted width would cost from here. A
    control variate fitted on more runs only gets better, so for it these are upper bounds in the mean.
    """
    found = []
    for result in results:
        if result["row"] not in wanted:
            continue
        made = result["estimators"][result["recommended"]]
        half = (made["calibrated"]["high"] - made["calibrated"]["low"]) / 2
        n_3d, n_0d = made["n_3d"], made["n_3d"] + result["n_propagation"]
        residual, explained = made["residual_variance"] * n_3d, made["propagation_variance"] * n_0d
        total = residual + explained
        rho = float(np.sqrt(explained / total)) if total > 0 else 0.0

        def more(width, half=half, variance=made["std"] ** 2, total=total, rho=rho, n_3d=n_3d, n_0d=n_0d):
            return additional_budget(total, rho, n_3d, n_0d, cost_ratio, variance * (width / half) ** 2)

        cost, more_3d, more_0d = more(wanted[result["row"]])
        found.append(
            Want(
                result["row"], wanted[result["row"]], half, int(np.ceil(more_3d)), int(np.ceil(more_0d)), cost,
                more(wanted[result["row"]] / 2)[0],
            )
        )  # fmt: skip
    return found


def _networks(runs: Runs, rows: list[Row], subsets, settings: Settings, seed: int) -> mfmc_ae.Networks:
    pairs = {}
    for row in rows:
        y, q = pair(runs, row)
        pairs[row.name] = (row.column_3d, y, row.column_0d, q)
    return mfmc_ae.train(runs.theta, analysis.box(runs), pairs, subsets, analysis.training(settings), seed)


def _ae_correlations(networks, runs: Runs, row: Row, trial: int, subset, emulator: Emulator, settings: Settings):
    """|ρ| of one trial's network on its own runs and on the others."""
    fit = mfmc_ae.IN_SAMPLE if trial == networks.folds else trial
    y, _ = pair(runs, row)
    places = mfmc_ae.nodes(networks, row.name, fit, settings.curve_nodes)
    theta = mfmc_ae.resampled(networks, row.name, fit, places)
    outputs = emulator.predict(np.log(theta))[row.column_0d]
    follows = mfmc_ae.along_curve(places, outputs, mfmc_ae.latent(networks, row.name, fit, runs.theta))
    others = np.setdiff1d(np.arange(len(runs)), subset)
    inside = correlation(y[subset], follows[subset])
    return abs(inside), float(np.sign(inside) * correlation(y[others], follows[others]))


def _best_held_out(runs: Runs, row: Row, subset) -> float:
    y, q = pair(runs, row)
    seen = Seen(np.log(runs.theta), q, runs.q[informative(runs.q, [row.column_0d])].to_numpy(float))
    others = np.setdiff1d(np.arange(len(runs)), subset)
    return correlation(y[others], selector.choose(seen[subset], y[subset]).predict(seen[others]))
