"""Failed runs: does failing depend on θ, on one input or on several together?"""

import numpy as np
from scipy import stats

from coronaryuq.core.seeds import generator
from coronaryuq.core.units import percent
from coronaryuq.estimation.analysis.diagnostics import Finding
from coronaryuq.estimation.runs.table import Runs

SIGNIFICANCE = 0.01
MANY = 0.1
PERMUTATIONS = 9999
BLOCK = 1000
MOST = 2000
"""Propagation samples among which failures are tested."""


def failed_not_at_random(runs: Runs, seed: int, scaling: str | None = None) -> Finding | None:
    """Warn of failures that depend on θ (see `dependence`), or of many failures."""
    failed = len(runs.theta_failed)
    if failed == 0:
        return None
    count, share = failed + len(runs), failed / (failed + len(runs))
    parts = runs.coordinates(runs.theta_failed), runs.coordinates(runs.theta)
    p, what = dependence(*parts, runs.inputs, seed, scaling)
    if p < SIGNIFICANCE:
        return Finding(
            "failures depend on inputs",
            f"{failed} of {count} 3D runs failed, not at random: {what} (p = {p:.1e})",
            "successful runs are reweighted to the means of the propagation sample",
        )
    if share > MANY:
        return Finding(
            "many failures",
            f"{failed} of {count} 3D runs failed ({percent(share)})",
            "left out; no dependence on inputs was found, but a weak one may be hidden",
        )
    return None


def failed_propagation(runs: Runs, seed: int, scaling: str | None = None) -> Finding | None:
    """Warn of propagation samples whose 0D run failed; whether that depends on θ is tested on MOST of the samples."""
    if runs.theta_more_failed is None or not len(runs.theta_more_failed):
        return None
    failed, ended = runs.theta_more_failed, runs.theta_more
    text = f"{len(failed)} of {len(failed) + len(ended)} 0D runs at propagation samples failed"
    rng = generator(seed, "failures", "propagation")
    failed, ended = (rng.permutation(part)[: MOST // 2] for part in (failed, ended))
    p, what = dependence(runs.coordinates(failed), runs.coordinates(ended), runs.inputs, seed, scaling)
    if p < SIGNIFICANCE:
        text += f", not at random: {what} (p = {p:.1e})"
    return Finding(
        "propagation runs failed", text, "left out: the estimate holds for inputs at which the 0D model runs"
    )


def dependence(
    failed: np.ndarray, ended: np.ndarray, inputs: tuple[str, ...], seed: int, scaling: str | None = None,
    permutations: int = PERMUTATIONS,
) -> tuple[float, str]:  # fmt: skip
    """Return the p-value of "failing does not depend on θ", and in words what differs most.

    failed (f, d), ended (n, d): coordinates of the inputs, as in `Runs.coordinates`.

    Two statistics of the failed runs' normal scores (van der Waerden), as every direction then has one law: the
    largest mean over single inputs, the mean of log θ, and the same with the input `scaling` apart and multiplied on;
    and the squared length of the mean after whitening, Hotelling's, for any other direction. Each is compared with
    random choices of as many runs, and so is the smaller of the two p-values (min-p, Westfall & Young 1993): the level
    holds whatever the number of inputs and their correlation.
    """
    logs = np.vstack([failed, ended])
    moving = np.ptp(logs, axis=0) > 0
    if not moving.any():
        return 1.0, ""
    names = [name for name, moves in zip(inputs, moving, strict=True) if moves]
    logs = logs[:, moving]
    single = _scores(logs)
    levels, level_names = _levels(logs, names, scaling)
    directions = np.column_stack([single, *(_scores(level) for level in levels)])
    directions = directions / directions.std(axis=0)
    u, size, _ = np.linalg.svd(single - single.mean(axis=0), full_matrices=False)
    whitened = u[:, size > 1e-6 * size[0]]

    chosen = _choices(len(logs), len(failed), permutations, seed)
    means = np.abs(_sums(directions, chosen))
    largest = _p_values(means.max(axis=1))
    together = _p_values((_sums(whitened, chosen) ** 2).sum(axis=1))
    p = float(_p_values(-np.minimum(largest, together))[0])
    if largest[0] <= together[0]:
        return p, f"{[*names, *level_names][int(means[0].argmax())]} differs"
    return p, f"inputs together differ, above all {names[int(means[0, : len(names)].argmax())]}"


def _levels(logs: np.ndarray, names: list[str], scaling: str | None) -> tuple[list[np.ndarray], list[str]]:
    """Return common levels of all inputs: vectors (n,) and their names."""
    others = [j for j, name in enumerate(names) if name != scaling]
    if len(others) < 2:
        return [], []
    mean = logs[:, others].mean(axis=1)
    if len(others) == len(names):
        return [mean], ["the mean of all inputs"]
    scaled = mean + logs[:, [name == scaling for name in names]][:, 0]
    return [mean, scaled], [f"the mean of all inputs but {scaling}", f"{scaling} times the mean of the others"]


def _scores(values: np.ndarray) -> np.ndarray:
    return stats.norm.ppf((stats.rankdata(values, axis=0) - 0.5) / len(values))


def _choices(count: int, size: int, permutations: int, seed: int) -> np.ndarray:
    """Draw indices (1 + permutations, size): the failed runs themselves first, then random sets of runs."""
    rng = generator(seed, "failures", count, size)
    drawn = [np.arange(size)[None]]
    for first in range(0, permutations, BLOCK):
        rows = min(BLOCK, permutations - first)
        drawn.append(np.sort(rng.random((rows, count)).argpartition(size - 1, axis=1)[:, :size], axis=1))
    return np.vstack(drawn)


def _sums(columns: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Sum rows of (n, k) over each choice, rounded so that equal sums count as ties."""
    blocks = np.array_split(chosen, -(-len(chosen) // BLOCK))
    return np.round(np.vstack([columns[block].sum(axis=1) for block in blocks]), 9)


def _p_values(statistic: np.ndarray) -> np.ndarray:
    """Share of all entries that are at least as large as each."""
    return stats.rankdata(-statistic, method="max") / len(statistic)
