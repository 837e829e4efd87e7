"""Hyper-parameters of MFMC-AE by Optuna, judged on runs that the networks have not seen."""

from pathlib import Path

import numpy as np
import optuna

from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.campaign import analysis
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.estimators.montecarlo import correlation
from coronaryuq.estimation.runs.table import Row, Runs, pair, read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae
from coronaryuq.estimation.surrogates.emulator import Emulator


def held_out_loss(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> float:
    """Mean over rows of 1 − ρ², ρ pooled over folds between 3D output and the control variate of the fold's network.

    That is the share of plain Monte Carlo's variance which no number of 0D runs takes away. The 0D model at resampled
    inputs is an emulator of all pilot 0D runs, which know nothing of a 3D output.
    """
    networks = analysis.train(runs, rows, settings, seed)
    fold = assign(len(runs), count(len(runs), settings.folds), seed)
    names = list(dict.fromkeys(row.column_0d for row in rows))
    emulator, lost = Emulator(np.log(runs.theta), runs.q[names]), []
    for row in rows:
        y, _ = pair(runs, row)
        held = np.empty(len(y))
        for k in range(networks.folds):
            places = mfmc_ae.nodes(networks, row.name, k, settings.curve_nodes)
            outputs = emulator.predict(np.log(mfmc_ae.resampled(networks, row.name, k, places)))[row.column_0d]
            along = mfmc_ae.along_curve(places, outputs, mfmc_ae.latent(networks, row.name, k, runs.theta))
            train, test = fold != k, fold == k
            slope = (
                np.polyfit(along[train], y[train], 1) if np.ptp(along[train]) > 0 else np.array([0.0, y[train].mean()])
            )
            held[test] = np.polyval(slope, along[test])
        lost.append(1 - max(0.0, correlation(y, held)) ** 2)
    return float(np.mean(lost))


def tune(runs_folder: str | Path, rows_csv: str | Path, settings: Settings, seed: int, out_json: str | Path) -> dict:
    """Search learning rate, decay, batch and the split of steps; write {best, loss, default_loss, trials}.

    `best` holds the settings to put into the configuration. The defaults are the first trial, so the search is never
    worse than they are on what it is judged by; a fresh seed tells how much of the gain is chance (`loss_new_seed`).
    """
    runs = read_runs(runs_folder)
    rows = analysis.chosen_rows(read_rows(rows_csv), settings, rows_csv)
    total = sum(settings.steps)

    def asked(trial: optuna.Trial) -> Settings:
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
    study.optimize(lambda trial: held_out_loss(runs, rows, asked(trial), seed), n_trials=settings.tuning_trials)
    best = asked(optuna.trial.FixedTrial(study.best_params))
    found = {
        "best": best.model_dump(mode="json", include={"learning_rate", "decay", "batch", "steps"}),
        "loss": study.best_value, "default_loss": study.trials[0].value,
        "loss_new_seed": held_out_loss(runs, rows, best, seed + 1),
        "default_loss_new_seed": held_out_loss(runs, rows, settings, seed + 1),
        "trials": [{"loss": trial.value, **trial.params} for trial in study.trials],
    }  # fmt: skip
    write_json(out_json, found)
    return found
