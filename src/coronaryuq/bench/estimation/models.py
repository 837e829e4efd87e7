"""Benchmark `models`: error of crossfit-GP beside that of the best linear combination of all 0D outputs.

MFMC uses one 0D output, BLUE several. MLBLUE is PyApprox's, without cross-fitting, where PyApprox 2 is installed: with
independent groups of samples a group ACV estimator of a mean is the same.
"""

import argparse
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np

from coronaryuq.bench.estimation.coverage import CONTROL_VARIATES, FOLDS, cross_fitted
from coronaryuq.bench.estimation.pairs import PAIRS
from coronaryuq.bench.estimation.problems import SEED, Problem, Trial, from_pair, from_runs
from coronaryuq.core.errors import InputError
from coronaryuq.estimation.estimators import blue
from coronaryuq.estimation.estimators.blue import Group
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.runs.table import read_rows, read_runs

N_3D, TRIALS, QUICK_TRIALS = 50, 30, 6
RUNS_PER_MODEL = 10
Found = tuple[float, float]
"""An estimate and its reported standard error."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--data", metavar="FOLDER", help="also resample the published runs in this folder")
    parser.add_argument("--rows", metavar="FILE", help="columns row, column_3d, column_0d (default: FOLDER/table1.csv)")


def run(quick: bool = False, data: str | None = None, rows: str | None = None) -> dict:
    """Run the benchmark on the analytic pairs, and on published runs if `data` is their folder.

    One cell per problem and method: `rms_error` over repeated trials, the same for all methods; `over_mc`, its ratio to
    that of plain Monte Carlo; and for analytic pairs `claimed_over_empirical`, root mean square of the reported
    standard errors over it. In trials of published runs the truth is the mean of a finite set, whose residuals add to
    the error of every method. The relative error of `rms_error` is about 1 / sqrt(2 trials). `pyapprox`: its version.
    """
    if rows and not data:
        raise InputError("bench models", "--rows", rows, "needs --data, the folder of published runs")
    start, theirs = time.process_time(), _pyapprox()
    problems = [from_pair(pair) for pair in PAIRS.values()]
    if data:
        folder = Path(data).absolute()
        runs = read_runs(folder)
        problems += [from_runs(runs, row) for row in read_rows(rows or folder / "table1.csv")]
    cells: list[dict] = []
    for problem in problems:
        cells += cells_of(problem, N_3D, QUICK_TRIALS if quick else TRIALS, theirs is not None)
        print(f"{problem.name}: {time.process_time() - start:.0f} CPU-s", file=sys.stderr, flush=True)
    return {
        "n_3d": N_3D, "trials": QUICK_TRIALS if quick else TRIALS, "pyapprox": theirs, "cells": cells,
        "cpu_s": time.process_time() - start,
    }  # fmt: skip


def cells_of(problem: Problem, n: int, trials: int, pyapprox: bool) -> list[dict]:
    """Run every method on the same trials of one problem, and return a cell of each."""
    methods: dict[str, Callable[[Trial, np.ndarray], Found]] = {
        **{name: _cross_fitted(name) for name in CONTROL_VARIATES}, "BLUE": _blue
    } | ({"MLBLUE": _mlblue} if pyapprox else {})  # fmt: skip
    errors, claims = np.empty((trials, len(methods))), np.empty((trials, len(methods)))
    finite = False
    for number in range(trials):
        trial, fold = problem.draw(n, number), assign(n, count(n, FOLDS), SEED, "coverage", number)
        found = np.array([method(trial, fold) for method in methods.values()])
        errors[number], claims[number], finite = found[:, 0] - trial.truth(fold), found[:, 1], trial.target > 0
    rms, claimed = np.sqrt(np.mean(errors**2, axis=0)), np.sqrt(np.mean(claims**2, axis=0))
    return [
        {"problem": problem.name, "method": name, "rms_error": float(rms[i]), "over_mc": float(rms[i] / rms[0])}
        | ({} if finite else {"claimed_over_empirical": float(claimed[i] / rms[i])})
        for i, name in enumerate(methods)
    ]


def _cross_fitted(name: str) -> Callable[[Trial, np.ndarray], Found]:
    def method(trial: Trial, fold: np.ndarray) -> Found:
        estimate = cross_fitted(trial, fold, CONTROL_VARIATES[name])
        return estimate.mean, estimate.std

    return method


def _columns(trial: Trial) -> list[int]:
    """Return the 0D outputs that move, one for every RUNS_PER_MODEL pilot runs and two at least."""
    moving = np.flatnonzero(np.ptp(trial.seen.outputs, axis=0) > 0)
    return list(moving[: max(2, len(trial.y) // RUNS_PER_MODEL)])


def _blue(trial: Trial, fold: np.ndarray) -> Found:
    columns = _columns(trial)
    cheap = tuple(range(1, 1 + len(columns)))
    pilot = Group((0, *cheap), np.column_stack([trial.y, trial.seen.outputs[:, columns]]))
    estimate = blue.estimate([pilot, Group(cheap, trial.more.outputs[:, columns])], int(fold.max()) + 1, SEED)
    return estimate.mean, estimate.std


def _mlblue(trial: Trial, fold: np.ndarray) -> Found:
    """PyApprox's estimator with the covariance of the whole pilot; it has no folds."""
    from pyapprox.statest.groupacv import FittedGroupACVEstimator, GroupACVAllocationResult, MLBLUEEstimator
    from pyapprox.statest.statistics import MultiOutputMean
    from pyapprox.util.backends.numpy import NumpyBkd

    columns = _columns(trial)
    pilot, more = trial.seen.outputs[:, columns].T, trial.more.outputs[:, columns].T
    n, m, models = len(trial.y), len(trial.more), len(columns) + 1
    statistic = MultiOutputMean(1, NumpyBkd())
    statistic.set_pilot_quantities(np.cov(np.vstack([trial.y, pilot])))
    subsets = [np.arange(models), np.arange(1, models)]
    estimator = MLBLUEEstimator(statistic, np.ones(models), model_subsets=subsets)
    counts = np.array([n, *[n + m] * (models - 1)])
    allocation = GroupACVAllocationResult(np.array([n, m]), counts, float(counts.sum()), np.zeros(1), True)
    fitted = FittedGroupACVEstimator(estimator, allocation)
    values = [trial.y[None], *(np.concatenate(pair)[None] for pair in zip(pilot, more, strict=True))]
    return float(fitted(values)[0]), float(fitted.covariance()[0, 0] ** 0.5)


def _pyapprox() -> str | None:
    """Return the version of PyApprox, None without PyApprox 2."""
    try:
        version = metadata.version("pyapprox")
    except metadata.PackageNotFoundError:
        return None
    return version if int(version.split(".")[0]) >= 2 else None
