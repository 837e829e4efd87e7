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
from coronaryuq.estimation.influence import CENTRE, Influence, changes
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
    from the published runs without replacement; the runs left over are the propagation samples, and the mean of their
    3D outputs, which nothing has seen, is the truth. Pilot and rest differ with the variance var (1 / N_3D + 1 / rest),
    so claimed variances carry the factor N / rest. `quick`: linear methods, 25 and 50 runs, 400 trials.
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
        seen, y, more, truth, factor = draw(n, trial)
        fold = assign(n, count(n, FOLDS), SEED, "coverage", trial)
        estimate = cross_fitted(seen, y, more, fold, CONTROL_VARIATES[method], known=factor > 1)
        means[trial], stds[trial] = estimate.mean - truth, estimate.std * factor
        centre, half = estimate.mean, estimate.interval.half_width * factor
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


def cross_fitted(seen: Seen, y, more: Seen, fold, fit, known: bool):
    """Cross-fitted estimate of one trial; `known`: `more` is all there is, so a control variate's mean is exact."""
    n, k = len(y), int(fold.max()) + 1
    held, moved, blocks, centres = np.empty(n), np.zeros((n, n)), [], []
    for j in range(k):
        train, test = np.flatnonzero(fold != j), np.flatnonzero(fold == j)
        fitted = fit(seen[train], y[train])
        held[test] = fitted.predict(seen[test])
        moved[test] = changes(fitted, seen[test], train, n)
        mine = more if known else more[np.arange(len(more)) % k == j]
        values = fitted.predict(mine)
        blocks.append(Propagated(np.full(2, values.mean()) if known else values))
        centres.append(changes(fitted, mine[: 8 * CENTRE], train, n))
    between = Influence(fold, moved, centres, [np.ones(len(c)) for c in centres]).between()
    return combine("", y, held, blocks, fold, n, beta=1.0 if known else None, between=between)


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
        order = generator(SEED, "coverage", "runs", n, trial).permutation(len(y))
        index, rest = order[:n], order[n:]
        factor = float(np.sqrt(len(y) / len(rest)))
        return everything[index], y[index], everything[rest], float(y[rest].mean()), factor

    return f"row {row.name}", draw
