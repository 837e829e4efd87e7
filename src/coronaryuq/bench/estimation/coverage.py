"""Benchmark `coverage`: reported and empirical standard error, and coverage of 95 % intervals, over many trials."""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from coronaryuq.bench.estimation import coverage_autoencoder, coverage_tails, dependent_samples
from coronaryuq.bench.estimation.pairs import PAIRS
from coronaryuq.bench.estimation.problems import ROW, SEED, Problem, Trial, from_pair, from_runs, runs_of
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.estimation.analysis import diagnostics
from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.estimators.crossfit import CrossFit, Estimate, Options, Propagated, combine
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.estimators.folds import assign, count
from coronaryuq.estimation.estimators.influence import CENTRE, Influence, changes
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import selector
from coronaryuq.estimation.surrogates.control_variates import METHODS, Method

FOLDS = 5
SIZES = (25, 50, 100, 250)
CONTROL_VARIATES: dict[str, Method] = {
    "MC": METHODS["constant"],
    "MFMC": METHODS["linear 0D"],
    "crossfit-GP": selector.choose,
}


REWEIGHTED = "inputs differ"
"""Warning with which the pilot gets weights."""
RECOMMENDED = "recommended"
"""The whole of `analyse`, and what it recommends."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--data", metavar="FOLDER", help="also resample the published runs in this folder")
    parser.add_argument("--rows", metavar="FILE", help="columns row, column_3d, column_0d (default: FOLDER/table1.csv)")


def run(
    quick: bool = False, data: str | None = None, rows: str | None = None, trials: int = 400,
    sizes: tuple[int, ...] = (), methods: tuple[str, ...] = (), problems: tuple[str, ...] = (),
) -> dict:  # fmt: skip
    """Run the benchmark on the analytic pairs, and on published runs if `data` is their folder.

    `warned`, by another name `warned_share`, is the fraction of trials with a warning. `coverage_95_error` is the
    binomial standard error of the coverage, `coverage_95_low` and `_high` its Wilson 95 % interval. Method
    `recommended` runs the whole analysis and takes what it recommends. `methods` may name MFMC-AE, which takes some 5
    CPU-s per trial and is left out by default.
    `quick`: linear methods, 25 and 50 runs, 400 trials.
    """
    if rows and not data:
        raise InputError("bench coverage", "--rows", rows, "needs --data, the folder of published runs")
    sizes = sizes or ((25, 50) if quick else SIZES)
    methods = methods or (("MC", "MFMC") if quick else (*CONTROL_VARIATES, RECOMMENDED))
    start, cells = time.process_time(), []
    sources = [*(from_pair(p) for p in PAIRS.values()), *dependent_samples.problems()]
    if data:
        folder = Path(data).absolute()  # so that a message about one of its files contains its full path, also for "."
        runs = read_runs(folder)
        sources += [from_runs(runs, row) for row in read_rows(rows or folder / "table1.csv")]
    for problem in sources:
        for n in sizes if not problems or problem.name in problems else ():
            for method in methods:
                cells.append(run_cell(problem, n, method, trials))
                print(f"{problem.name}, N_3D = {n}, {method}: {cells[-1]}", file=sys.stderr, flush=True)
    beyond = [
        beside for name in PAIRS if not quick and (not problems or name in problems)
        for n in sizes for beside in run_tail_cells(name, n, trials)
    ]  # fmt: skip
    return {"cells": cells, "beyond_the_mean": beyond, "trials": trials, "cpu_s": time.process_time() - start}


def run_cell(problem: Problem, n: int, method: str, trials: int, first: int = 0) -> dict:
    """Run one cell: a problem, pilot size and method.

    first: number of the first trial; a rule chosen on some trials is tested on others.
    """
    numbers, cell = range(first, first + trials), {"problem": problem.name, "method": method, "n_3d": n}
    if method == RECOMMENDED:
        return cell | _recommended(problem, n, numbers)
    if method == "MFMC-AE":
        estimates = coverage_autoencoder.estimates(problem, n, numbers, FOLDS)
    else:
        estimates = _estimates(problem, n, numbers, CONTROL_VARIATES[method])
    found = [(truth, e, diagnostics.skewed(e) or diagnostics.unseen(n)) for truth, e in estimates]
    values = [(e.mean - truth, e.std, e.interval.holds(truth)) for truth, e, _ in found]
    warned = float(np.mean([warning is not None for _, _, warning in found]))
    return cell | judged(*(np.array(v) for v in zip(*values, strict=True))) | _fraction(warned)


def _recommended(problem: Problem, n: int, numbers: range) -> dict:
    """Run `analyse` on every trial; also the fraction of trials with a warning, and how often each was recommended."""
    values, taken, warned = [], Counter[str](), Counter[str]()
    for number in numbers:
        trial, settings = problem.draw(n, number), Settings(autoencoder=False, min_3d=4)
        runs = runs_of(trial)
        design = make_design(runs, [ROW], count(n, FOLDS), number)
        if trial.more_y is not None:
            design = replace(design, target=len(trial.more_y))
        (row,) = analyse(runs, [ROW], settings, number, design=design, beyond_mean=False)
        report, truth = row.recommended_report, trial.mean
        codes = {warning.split(":")[0] for warning in (*row.warnings, *report.warnings)}
        if (
            trial.more_y is not None
        ):  # a finite set, whose blocks count as the folds of the pilot, which may be weighted
            weights = diagnostics.balancing_weights(runs) if REWEIGHTED in codes else None
            in_blocks = [trial.more_y[block.index].mean() for block in design.blocks]
            truth = float(np.average(in_blocks, weights=np.bincount(design.fold, weights)))
        values.append((report.mean - truth, report.std, report.calibrated.holds(truth)))
        taken[row.recommended] += 1
        warned.update(codes | ({"any"} if codes else set()))
    found = judged(*(np.array(v) for v in zip(*values, strict=True)))
    shares = {code: warned[code] / len(numbers) for code in sorted(warned)}
    return found | _fraction(shares.pop("any", 0.0)) | {"warnings": shares, "recommended": dict(taken)}


def _fraction(warned: float) -> dict:
    return {"warned": warned, "warned_share": warned}


def run_tail_cells(name: str, n: int, trials: int, first: int = 0) -> list[dict]:
    """One cell per quantity beyond the mean of an analytic pair; `quantity` names it. first: as of `cell`."""
    found = coverage_tails.errors(name, n, trials, FOLDS, first)
    return [
        {"problem": name, "quantity": quantity, "method": "crossfit-GP", "n_3d": n} | judged(*values)
        for quantity, values in found.items()
    ]


def judged(errors: np.ndarray, stds: np.ndarray, holds: np.ndarray) -> dict:
    """Return standard errors (T,), errors (T,) and whether the interval covered (T,) as one cell."""
    trials, empirical = len(errors), errors.std(ddof=1)
    wilson = binomtest(int(holds.sum()), trials).proportion_ci(method="wilson")
    return {
        "trials": trials,
        "claimed_over_empirical": float(np.sqrt(np.mean(stds**2)) / empirical),
        "coverage_95": float(holds.mean()),
        "coverage_95_error": float(np.sqrt(0.95 * 0.05 / trials)),
        "coverage_95_low": float(wilson.low),
        "coverage_95_high": float(wilson.high),
        "bias_z": float(errors.mean() / (empirical / np.sqrt(trials))),
        "empirical_std": float(empirical),
    }


def _estimates(problem: Problem, n: int, numbers: range, fit: Method) -> Iterator[tuple[float, Estimate]]:
    for number in numbers:
        trial, fold = problem.draw(n, number), assign(n, count(n, FOLDS), SEED, "coverage", number)
        yield trial.truth(fold), cross_fitted(trial, fold, fit)


def cross_fitted(trial: Trial, fold: np.ndarray, fit: Method) -> Estimate:
    """Cross-fitted estimate of one trial."""
    seen, y, n = trial.seen, trial.y, len(trial.y)
    held, moved, variance, blocks, centres, variances = np.empty(n), np.zeros((n, n)), np.empty(n), [], [], []
    for j, block in enumerate(trial.blocks(int(fold.max()) + 1)):
        train, test = np.flatnonzero(fold != j), np.flatnonzero(fold == j)
        fitted = fit(seen[train], y[train])
        held[test], variance[test] = fitted.predict(seen[test]), fitted.variance(seen[test])
        moved[test] = changes(fitted, seen[test], train, n)
        more = trial.more[block]
        blocks.append(Propagated(fitted.predict(more)))
        some = more[:CENTRE]
        centres.append(changes(fitted, some, train, n))
        variances.append(fitted.variance(some))
    weights = [np.ones(len(c)) for c in centres]
    between = Influence(fold, moved, centres, weights, variance, variances).between()
    return combine("", CrossFit(y, held, blocks, fold), n, Options(between=between, target=trial.target))


def tabulate(found: list[str | Path], table_csv: str | Path) -> None:
    """Write the cells of several runs of this benchmark (JSON files) as one table; `quantity` is `mean` by default."""
    runs = [read_json(path) for path in found]
    cells = [cell for run in runs for cell in run["cells"] + run["beyond_the_mean"]]
    write_csv(table_csv, pd.DataFrame([{"quantity": "mean"} | cell for cell in cells]))
