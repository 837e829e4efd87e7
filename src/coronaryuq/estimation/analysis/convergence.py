"""Convergence of the correlations with the number of 3D runs."""

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.formulas import correlation
from coronaryuq.estimation.results import Convergence
from coronaryuq.estimation.runs.table import Row, Runs, pair
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae, selector
from coronaryuq.estimation.surrogates.control_variates import Seen
from coronaryuq.estimation.surrogates.emulator import Emulator, informative
from coronaryuq.estimation.training import train_on, with_networks


def subsamples(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> list[Convergence]:
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
        trained = with_networks(rows, settings)
        networks = train_on(runs, trained, fitted, settings, seed) if trained and fitted else None
        for row in rows:
            y, q = pair(runs, row)
            in_sample, held_out = None, None
            if networks is not None and row.name in networks.rows:
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
