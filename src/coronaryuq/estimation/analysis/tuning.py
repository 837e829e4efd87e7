"""Hyper-parameters of MFMC-AE by Optuna, judged on runs that the networks have not seen."""

from pathlib import Path
from typing import Any

import numpy as np
import optuna

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation import training
from coronaryuq.estimation.estimators.dependence import assign_runs
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.estimators.formulas import correlation
from coronaryuq.estimation.runs.table import Row, Runs, pair, read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae
from coronaryuq.estimation.surrogates.emulator import Emulator


def held_out_loss(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> float:
    """Return the mean over rows of 1 − ρ², ρ pooled over folds between 3D output and the fold's control variate.

    That is the fraction of plain Monte Carlo's variance that no number of 0D runs removes. The 0D model at resampled
    inputs is an emulator of all pilot 0D runs, which hold no information on a 3D output.
    """
    networks = training.train(runs, rows, settings, seed)
    fold, _ = assign_runs(runs, count(len(runs), settings.folds), seed)
    names = list(dict.fromkeys(row.column_0d for row in rows))
    emulator, lost = Emulator(runs.coordinates(runs.theta), runs.q[names]), []
    for row in rows:
        y, _ = pair(runs, row)
        held = np.empty(len(y))
        for k in range(networks.folds):
            places = mfmc_ae.nodes(networks, row.name, k, settings.curve_nodes)
            outputs = emulator.predict(runs.coordinates(mfmc_ae.resampled(networks, row.name, k, places)))[
                row.column_0d
            ]
            along = mfmc_ae.along_curve(places, outputs, mfmc_ae.latent(networks, row.name, k, runs.theta))
            train, test = fold != k, fold == k
            moves = np.ptp(along[train]) > 0
            line = np.polyfit(along[train], y[train], 1) if moves else np.array([0.0, y[train].mean()])
            held[test] = np.polyval(line, along[test])
        lost.append(1 - max(0.0, correlation(y, held)) ** 2)
    return float(np.mean(lost))


def tune(
    runs_folder: str | Path, rows_csv: str | Path, settings: Settings, seed: int, out_json: str | Path
) -> dict[str, Any]:
    """Search learning rate, decay, batch and the split of steps; write {best, loss, default_loss, trials}.

    `best` holds the settings to put into the configuration. The defaults are the first trial, so the search never ends
    worse than they are on its own criterion; a fresh seed shows how much of the gain is chance (`loss_new_seed`).

    Parameters
    ----------
    runs_folder, rows_csv
        Runs in the published-runs format (docs/reference/formats.md), and rows to judge by.
    settings, seed
        The defaults, with the number of trials, and the seed of networks and search.
    out_json
        File to write.

    Raises
    ------
    InputError
        If the folder is not as described, if a row does not exist, or if none has networks.
    """
    runs = read_runs(runs_folder)
    rows = [row for row in training.chosen_rows(read_rows(rows_csv), settings, rows_csv) if row.networks]
    if not rows:
        raise InputError(rows_csv, "networks", "no", "tuning needs a row whose networks are trained")
    total = sum(settings.steps)

    def suggested(trial: optuna.trial.BaseTrial) -> Settings:
        first = trial.suggest_float("first_share", 0.2, 0.8)
        return settings.model_copy(update={
            "learning_rate": trial.suggest_float("learning_rate", 5e-4, 2e-2, log=True),
            "decay": 1 - trial.suggest_float("fall", 1e-4, 5e-3, log=True),
            "batch": trial.suggest_categorical("batch", sorted({0, 64, 128, 256, settings.batch})),
            "steps": (round(first * total), total - round(first * total)),
        })  # fmt: skip

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed % 2**32))
    study.enqueue_trial({
        "first_share": settings.steps[0] / total, "learning_rate": settings.learning_rate,
        "fall": 1 - settings.decay, "batch": settings.batch,
    })  # fmt: skip
    study.optimize(lambda trial: held_out_loss(runs, rows, suggested(trial), seed), n_trials=settings.optuna_trials)
    best = suggested(optuna.trial.FixedTrial(study.best_params))
    result = {
        "best": best.model_dump(mode="json", include={"learning_rate", "decay", "batch", "steps"}),
        "loss": study.best_value, "default_loss": study.trials[0].value,
        "loss_new_seed": held_out_loss(runs, rows, best, seed + 1),
        "default_loss_new_seed": held_out_loss(runs, rows, settings, seed + 1),
        "trials": [{"loss": trial.value, **trial.params} for trial in study.trials],
    }  # fmt: skip
    write_json(out_json, result)
    return result
