"""Tests of residuals: all of them, their smooth part, and each measured series."""

from collections.abc import Callable, Iterator

import numpy as np
from scipy import stats

from coronaryuq.core.chi_squared import chi2_tail
from coronaryuq.core.harmonics import fourier_basis
from coronaryuq.discrepancy.inference.gp_discrepancy import phase_of
from coronaryuq.discrepancy.inference.problem import Problem

HARMONICS = 3
"""Harmonics of the smooth part."""


def residual_tests(
    problem: Problem,
    which: np.ndarray,
    objective: float,
    score: np.ndarray,
    project: Callable[[np.ndarray], np.ndarray],
) -> dict[str, float]:
    """Return p-values of whitened residuals e of the rows `which` (N,), whose covariance under the model is P^-1.

    objective: e' P e; score: P e (n,); project: v → P v for vectors (n, k). Tests: all residuals, their smooth part
    (mean and three harmonics of each series) and the worst single series (Bonferroni).
    """
    shapes, owners = smooth(problem, which)
    inner, along = shapes.T @ project(shapes), shapes.T @ score
    series = [np.flatnonzero(owners == owner) for owner in np.unique(owners)]
    each = [chi2_tail(inner[np.ix_(own, own)], along[own]) for own in series]
    return {
        "all residuals": float(stats.chi2.sf(objective, len(score))),
        "smooth part": chi2_tail(inner, along),
        "worst series": min(1.0, min(each) * len(each)),
    }


def phases(problem: Problem, which: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray | None]]:
    """Yield each series with rows among `which` (N,): number, positions among those rows, `phase_of` these or None."""
    owner = problem.owner[which]
    offsets = np.concatenate([np.arange(s.value.size) for s in problem.forward.measured])[which]
    for number, series in enumerate(problem.forward.measured):
        own = np.flatnonzero(owner == number)
        if own.size:
            phase = phase_of(series)
            yield number, own, None if phase is None else phase[offsets[own]]


def smooth(problem: Problem, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return whitened smooth shapes (n, k) of the residual of these rows, and the series of each."""
    sd = problem.sd[which]
    columns, owners = [], []
    for number, own, phase in phases(problem, which):
        for wave in fourier_basis(phase, HARMONICS).T if phase is not None else np.ones((1, own.size)):
            column = np.zeros(len(sd))
            column[own] = wave / sd[own]
            columns.append(column / np.linalg.norm(column))
            owners.append(number)
    return np.array(columns).T, np.array(owners)
