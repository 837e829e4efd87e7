"""Shapes of a residual: smooth waves of each measured series, and tests of residuals along them."""

from collections.abc import Callable, Iterator

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.inference.problem import Problem

HARMONICS = 3


def residual_tests(
    problem: Problem,
    which: np.ndarray,
    objective: float,
    score: np.ndarray,
    project: Callable[[np.ndarray], np.ndarray],
) -> dict[str, float]:
    """p-values of whitened residuals e of the rows `which` (N,), which under the model have covariance P^-1.

    objective: e' P e; score: P e, (n,); project: vectors (n, k) to P times them. Tested are all residuals, their smooth
    part (mean and three harmonics of each series) and the worst single series (Bonferroni).
    """
    shapes, owners = smooth(problem, which)
    inner, moved = shapes.T @ project(shapes), shapes.T @ score
    each = []
    for owner in np.unique(owners):
        mine = np.flatnonzero(owners == owner)
        each.append(chi2_tail(inner[np.ix_(mine, mine)], moved[mine]))
    return {
        "all residuals": float(stats.chi2.sf(objective, len(score))),
        "smooth part": chi2_tail(inner, moved),
        "worst series": min(1.0, min(each) * len(each)),
    }


def phases(problem: Problem, which: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray | None]]:
    """Each series with rows among `which` (N,): its number, its positions among those rows, its phases or None."""
    owner = problem.owner[which]
    offsets = np.concatenate([np.arange(s.value.size) for s in problem.forward.measured])[which]
    for number, series in enumerate(problem.forward.measured):
        mine = np.flatnonzero(owner == number)
        if mine.size:
            phase = None if series.time is None else (series.time[offsets[mine]] / series.period) % 1.0
            yield number, mine, phase


def smooth(problem: Problem, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smooth shapes of the residual of those rows in whitened numbers, (n, k), and the series that each belongs to."""
    sd = problem.sd[which]
    columns, owners = [], []
    for number, mine, phase in phases(problem, which):
        waves = [np.ones(mine.size)]
        if phase is not None:
            for h in range(1, HARMONICS + 1):
                waves += [np.cos(2 * np.pi * h * phase), np.sin(2 * np.pi * h * phase)]
        for wave in waves:
            column = np.zeros(len(sd))
            column[mine] = wave / sd[mine]
            columns.append(column / np.linalg.norm(column))
            owners.append(number)
    return np.array(columns).T, np.array(owners)


def chi2_tail(covariance: np.ndarray, vector: np.ndarray) -> float:
    """p-value of v' C^+ v against chi-squared with rank(C) degrees of freedom."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-6 * max(values[-1], 1e-300)
    rotated = vectors[:, kept].T @ vector
    return float(stats.chi2.sf(np.sum(rotated**2 / values[kept]), kept.sum()))
