"""MFMC-AE in repeated trials: networks of many trials trained as one batch, each trial estimated as in a campaign."""

from collections.abc import Iterator

import numpy as np

from coronaryuq.bench.estimation.problems import ROW, SEED, Problem, Trial, as_design, runs_of
from coronaryuq.estimation import training
from coronaryuq.estimation.estimators import per_row
from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae

# Trials trained together: more networks at once no longer fit into a cache.
TOGETHER = 4


def estimates(
    problem: Problem, n: int, trials: range, folds: int, settings: Settings | None = None
) -> Iterator[tuple[float, Estimate]]:
    """Yield the true mean of each trial and its cross-fitted estimate, trained with `settings`."""
    settings = settings or Settings()
    k = count(n, folds)
    for first in range(0, len(trials), TOGETHER):
        numbers = trials[first : first + TOGETHER]
        drawn = [problem.draw(n, number) for number in numbers]
        fold = [assign(n, k, SEED, "coverage", number) for number in numbers]
        networks = _trained(drawn, fold, settings, SEED + numbers[0])
        for at, (trial, own) in enumerate(zip(drawn, fold, strict=True)):
            # The fit to all runs is not used: the last network takes its place.
            fits = [*range(at * k, at * k + k), at * k + k - 1]
            yield trial.truth(own), _estimate(problem, trial, own, networks.select(ROW.name, fits), settings)


def _trained(drawn: list[Trial], fold: list[np.ndarray], settings: Settings, seed: int) -> mfmc_ae.Networks:
    every = [runs_of(trial) for trial in drawn]
    theta = np.vstack([runs.theta for runs in every])
    boxes = np.array([training.box(runs) for runs in every])
    box = np.column_stack([boxes[:, :, 0].min(axis=0), boxes[:, :, 1].max(axis=0)])
    y, q = np.concatenate([trial.y for trial in drawn]), np.concatenate([trial.seen.row_output for trial in drawn])
    fits = [at * len(f) + fit for at, f in enumerate(fold) for fit in mfmc_ae.fits_of(f)[:-1]]
    pairs = {ROW.name: (ROW.column_3d, y, ROW.column_0d, q)}
    return mfmc_ae.train(theta, box, pairs, fits, training.training_settings(settings), seed)


def _estimate(problem: Problem, trial: Trial, fold: np.ndarray, networks: mfmc_ae.Networks, settings: Settings):
    design, curves = as_design(trial, fold), dict[int, tuple[np.ndarray, np.ndarray]]()
    for k in range(len(design.blocks)):
        places = mfmc_ae.nodes(networks, ROW.name, k, settings.curve_nodes)
        curves[k] = places, problem.low(mfmc_ae.resampled(networks, ROW.name, k, places))
    return per_row.autoencoder(design, ROW, networks, curves, settings.level)
