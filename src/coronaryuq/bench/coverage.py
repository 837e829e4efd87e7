"""Benchmark `coverage`: claimed against empirical spread, and coverage of 95 % intervals, over repeated trials."""

import sys
import time

import numpy as np

from coronaryuq.bench.pairs import PAIRS, Pair
from coronaryuq.estimation import selector
from coronaryuq.estimation.control_variates import METHODS, Seen
from coronaryuq.estimation.crossfit import Propagated, combine
from coronaryuq.estimation.diagnostics import unverified
from coronaryuq.estimation.folds import assign, count
from coronaryuq.estimation.runs import Row, Runs, pair, read_rows, read_runs
from coronaryuq.seeds import generator

SEED, FOLDS, PROPAGATION = 20241117, 5, 2000
SIZES = (25, 50, 100, 250)
CONTROL_VARIATES = {
    "MC": METHODS["constant"],
    "MFMC": METHODS["linear 0D"],
    "best": selector.choose,
}


def run(
    quick: bool = False, data: str | None = None, rows: str | None = None, trials: int = 400,
    sizes: tuple[int, ...] = (), methods: tuple[str, ...] = (), problems: tuple[str, ...] = (),
) -> dict:  # fmt: skip
    """Cells as in the list of benchmarks. `coverage_95_error` is the binomial standard error of the coverage.

    Analytic pairs draw everything anew in each trial, 2,000 propagation samples among it. With `data`, pilots are drawn
    from the published runs without replacement and the truth is the mean of all runs; the claimed variance carries the
    factor 1 − N_3D / N of a finite population. `quick`: linear methods, 25 and 50 runs, 400 trials.
    """
    sizes = sizes or ((25, 50) if quick else SIZES)
    methods = methods or (("MC", "MFMC") if quick else tuple(CONTROL_VARIATES))
    start, cells = time.process_time(), []
    sources = [_from_pair(p) for name, p in PAIRS.items() if not problems or name in problems]
    if data:
        runs = read_runs(data)
        sources += [
            _from_runs(runs, row)
            for row in read_rows(rows or f"{data}/table1.csv")
            if not problems or f"row {row.name}" in problems
        ]
    for name, draw in sources:
        for n in sizes:
            for method in methods:
                cells.append(cell(name, draw, n, method, trials))
                print(f"{name}, N_3D = {n}, {method}: {cells[-1]}", file=sys.stderr, flush=True)
    return {"cells": cells, "trials": trials, "cpu_s": time.process_time() - start}


def cell(name: str, draw, n: int, method: str, trials: int) -> dict:
    """One problem, pilot size and method: `draw(n, trial)` gives what a trial sees."""
    means, stds, holds = np.empty(trials), np.empty(trials), np.empty(trials, dtype=bool)
    for trial in range(trials):
        seen, y, more, truth, finite = draw(n, trial)
        fold = assign(n, count(n, FOLDS), SEED, "coverage", trial)
        estimate = cross_fitted(seen, y, more, fold, CONTROL_VARIATES[method], finite)
        means[trial], stds[trial] = estimate.mean - truth, estimate.std * finite
        centre, half = estimate.mean, estimate.interval.half_width * finite
        holds[trial] = abs(centre - truth) <= half
    empirical = means.std(ddof=1)
    return {
        "problem": name, "method": method, "n_3d": n, "trials": trials,
        "claimed_over_empirical": float(np.sqrt(np.mean(stds**2)) / empirical),
        "coverage_95": float(holds.mean()),
        "coverage_95_error": float(np.sqrt(0.95 * 0.05 / trials)),
        "bias_z": float(means.mean() / (empirical / np.sqrt(trials))),
        "empirical_std": float(empirical),
        "warned": unverified(method, n) is not None,
    }  # fmt: skip


def cross_fitted(seen: Seen, y, more: Seen | list[Seen], fold, fit, finite: float):
    """Cross-fitted estimate of one trial; a finite population knows the exact mean of a control variate."""
    k = int(fold.max()) + 1
    held, blocks = np.empty(len(y)), []
    for j in range(k):
        train, test = fold != j, fold == j
        fitted = fit(seen[train], y[train])
        held[test] = fitted.predict(seen[test])
        if finite < 1:
            blocks.append(Propagated(np.full(2, fitted.predict(more).mean())))
        else:
            blocks.append(Propagated(fitted.predict(more[np.arange(len(more)) % k == j])))
    return combine("", y, held, blocks, fold, len(y), beta=1.0 if finite < 1 else None)


def _from_pair(problem: Pair):
    def see(theta):
        low = problem.low(theta)
        return Seen(np.log(theta), low[:, 0], low)

    def draw(n, trial):
        rng = generator(SEED, "coverage", problem.name, n, trial)
        theta, more = problem.draw(rng, n), problem.draw(rng, PROPAGATION)
        return see(theta), problem.high(theta), see(more), problem.mean, 1.0

    return problem.name, draw


def _from_runs(runs: Runs, row: Row):
    from coronaryuq.estimation.emulator import informative

    y, q = pair(runs, row)
    outputs = runs.q[informative(runs.q, [row.column_0d])].to_numpy(float)
    everything = Seen(np.log(runs.theta), q, outputs)

    def draw(n, trial):
        index = generator(SEED, "coverage", "runs", n, trial).permutation(len(y))[:n]
        return everything[index], y[index], everything, float(y.mean()), float(np.sqrt(1 - n / len(y)))

    return f"row {row.name}", draw
