"""Every estimate of every row of one set of runs; the stage and the benchmarks call this."""

from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.estimation.campaign import diagnostics, failures, tables
from coronaryuq.estimation.campaign.paper import paper_row
from coronaryuq.estimation.estimators import multilevel_crossfit, per_row, tails_and_sobol
from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.estimators.folds_and_blocks import Design, make_design
from coronaryuq.estimation.estimators.montecarlo import correlation, mfmc_variance
from coronaryuq.estimation.runs.table import Row, Runs, pair
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae

EMULATOR_SHARE = 1e-2


def chosen_rows(rows: list[Row], settings: Settings, file) -> list[Row]:
    """The rows that the settings ask for; one that is not there is an `InputError`."""
    for name in settings.rows:
        if name not in {row.name for row in rows}:
            raise InputError(file, "row", name, f"no such row; the file has {', '.join(row.name for row in rows)}")
    return [row for row in rows if not settings.rows or row.name in settings.rows]


def enough(runs: Runs, settings: Settings) -> None:
    if len(runs) < settings.min_3d:
        raise InputError(
            runs.folder / "outputs_3d.csv", "usable 3D runs", len(runs), f"estimation.min_3d is {settings.min_3d}"
        )
    if len(runs.theta_more) < 2 * count(len(runs), settings.folds):
        raise InputError(
            runs.folder / "params_propagation.csv",
            "samples",
            len(runs.theta_more),
            "draw inputs at which the 0D model alone is run (or params_propagation_normalized.csv)",
        )


def box(runs: Runs) -> np.ndarray:
    """θ at −1 and +1 for the networks (d, 2): the limits where given, widened to hold every sample."""
    everywhere = np.vstack([runs.theta, runs.theta_more]) if len(runs.theta_more) else runs.theta
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    if runs.limits is not None:
        low, high = np.minimum(low, runs.limits[:, 0]), np.maximum(high, runs.limits[:, 1])
    return np.column_stack([low, np.where(high > low, high, low + 1.0)])


def training(settings: Settings) -> mfmc_ae.Training:
    return mfmc_ae.Training(
        settings.steps, settings.batch, settings.learning_rate, settings.decay, settings.restarts, settings.correlation
    )


def train(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> mfmc_ae.Networks:
    """MFMC-AE networks of all rows and folds."""
    fold = assign(len(runs), count(len(runs), settings.folds), seed)
    pairs = {}
    for row in rows:
        y, q = pair(runs, row)
        pairs[row.name] = (row.column_3d, y, row.column_0d, q)
    return mfmc_ae.train(runs.theta, box(runs), pairs, mfmc_ae.fits_of(fold), training(settings), seed)


def wanted_0d(networks: mfmc_ae.Networks, runs: Runs, nodes: int) -> pd.DataFrame:
    """0D inputs that MFMC-AE wants: `sample` (ROW.FOLD.NODE, fold `all` for the in-sample fit) and θ."""
    frames = []
    for row in networks.rows:
        for k in [*range(networks.folds), mfmc_ae.IN_SAMPLE]:
            theta = mfmc_ae.resampled(networks, row, k, mfmc_ae.nodes(networks, row, k, nodes))
            frame = pd.DataFrame(theta, columns=list(runs.inputs))
            frame.insert(0, "sample", [sample_name(row, k, i) for i in range(len(theta))])
            frames.append(frame)
    return pd.concat(frames, ignore_index=True)


def sample_name(row: str, k: int, node: int) -> str:
    return f"{row}.{'all' if k == mfmc_ae.IN_SAMPLE else k}.{node:03d}"


def curves_of(networks: mfmc_ae.Networks, row: Row, outputs: pd.Series, nodes: int) -> dict:
    """fold → (places, 0D outputs) of one row; failed 0D runs are left out of the curve, no curve below 3 of them."""
    curves = {}
    for k in [*range(networks.folds), mfmc_ae.IN_SAMPLE]:
        places = mfmc_ae.nodes(networks, row.name, k, nodes)
        values = outputs.reindex([sample_name(row.name, k, i) for i in range(len(places))]).to_numpy(float)
        ended = np.isfinite(values)
        if ended.sum() < 3:
            return {}
        curves[k] = (places[ended], values[ended])
    return curves


def analyse(
    runs: Runs, rows: list[Row], settings: Settings, seed: int,
    networks: mfmc_ae.Networks | None = None, resampled: pd.DataFrame | None = None, design: Design | None = None,
    beyond_mean: bool = True,
) -> list[dict]:  # fmt: skip
    """Rows of `estimates.json`. `resampled`: 0D outputs at the inputs of `wanted_0d`, index `sample`.

    `beyond_mean`: quantiles, probabilities, variance and Sobol indices too.
    """
    enough(runs, settings)
    k = count(len(runs), settings.folds)
    design = design or make_design(runs, rows, k, seed, settings.known_scaling)
    failed = failures.failed_not_at_random(runs, seed, settings.known_scaling)
    findings = [f for f in (diagnostics.different_inputs(runs), failed) if f]
    weights = diagnostics.balancing_weights(runs) if findings else None
    best, several, results = {}, {}, []
    for row in rows:
        y, q = pair(runs, row)
        level = settings.level
        if row.column_3d not in best:
            made_best = per_row.predict(design, row)
            best[row.column_3d] = (
                per_row.best(design, row, made_best, level, weights),
                tails_and_sobol.everything(design, row, made_best, settings) if beyond_mean else {},
            )
        made = {
            "MC": per_row.monte_carlo(design, row, level, weights),
            "MFMC": per_row.mfmc(design, row, level, weights),
            "best": best[row.column_3d][0],
        }
        more = {"MFMC": {"rho_in_sample": correlation(y, q)}}
        if networks is not None and resampled is not None:
            curves = curves_of(networks, row, resampled[row.column_0d], settings.curve_nodes)
            if curves:
                made["MFMC-AE"] = per_row.autoencoder(design, row, networks, curves, level, weights)
                in_sample = per_row.autoencoder_in_sample(design, row, networks, curves)
                claimed = mfmc_variance(np.var(y), in_sample, len(y), len(y) + len(runs.theta_more))
                more["MFMC-AE"] = {"rho_in_sample": in_sample, "std_in_sample": float(claimed**0.5)}
                theta = np.vstack([mfmc_ae.resampled(networks, row.name, j, curves[j][0]) for j in range(k)])
                finding = diagnostics.outside_support(theta, runs.theta, runs.inputs)
                if finding:
                    made["MFMC-AE"] = replace(made["MFMC-AE"], warnings=(*made["MFMC-AE"].warnings, str(finding)))
        left = None
        if weights is None:
            # Pilot runs that are reweighted to the propagation inputs would need weights on a coarse level too.
            blue = per_row.several_models(design, row, seed, level)
            made |= {"BLUE": blue} if blue is not None else {}
            if row.column_3d not in several:
                several[row.column_3d] = multilevel_crossfit.multilevel(design, row, level)
            if several[row.column_3d] is not None:
                made["multilevel"], left = several[row.column_3d]
                finding = diagnostics.coarse_failures(runs)
                if finding:
                    made["multilevel"] = replace(made["multilevel"], warnings=(str(finding),))
        for name in made:
            finding = diagnostics.unverified(name, len(y), _residual_share(made[name]))
            if finding:
                made[name] = replace(made[name], warnings=(*made[name].warnings, str(finding)))
        for name in [name for name in made if name != "MC"]:
            finding = diagnostics.useless(made[name].rho_held_out, len(y), name)
            if finding:
                made[name] = replace(made[name], warnings=(*made[name].warnings, str(finding)))
        if design.emulator_error[row.column_0d] > EMULATOR_SHARE:
            made["MFMC"] = replace(made["MFMC"], warnings=(*made["MFMC"].warnings, _poor(design, row)))
        order = [name for name in ("MC", "MFMC", "MFMC-AE", "BLUE", "best", "multilevel") if name in made]
        printed = paper_row(y, q, max(len(runs.theta_more), len(y)))  # the paper counts the pilot into its N_0D
        results.append({
            "row": row.name, "label": row.label, "column_3d": row.column_3d, "column_0d": row.column_0d,
            "variance_3d": float(np.var(y, ddof=1)),
            "paper": {"rho_original": printed.rho_original, "std_mc": printed.std_mc, "std_mfmc": printed.std_mfmc},
            "estimators": {name: tables.estimate(made[name]) | more.get(name, {}) for name in order},
            "recommended": recommended(made),
            "beyond_the_mean": best[row.column_3d][1],
            "levels": None if left is None else asdict(left),
            "n_propagation": len(runs.theta_more),
            "emulator_error": design.emulator_error[row.column_0d],
            "integrated_exactly": settings.known_scaling if design.integrated else None,
            "warnings": [str(f) for f in (*findings, diagnostics.dominated(made["best"].residuals, runs.samples)) if f],
        })  # fmt: skip
    return results


def recommended(made: dict) -> str:
    """The estimator with the least claimed standard deviation among plain MC and those without a warning."""
    sound = {name: value.std for name, value in made.items() if name == "MC" or not value.warnings}
    return min(sound, key=sound.get)


def _residual_share(estimate: Estimate) -> float:
    total = estimate.residual_variance + estimate.propagation_variance
    return estimate.residual_variance / total if total > 0 else 1.0


def _poor(design: Design, row: Row) -> str:
    return f"the emulator of {row.column_0d} misses {design.emulator_error[row.column_0d]:.1%} of its variance"
