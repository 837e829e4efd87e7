"""Where model and measurements disagree: whitened residuals by vessel, quantity, phase and condition."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.problem import Problem

HARMONICS = 3
BINS = 4
LEAST_LEARNT = 0.01
"""Share of a nuisance parameter's prior variance that the data must take away to test it against its prior."""


@dataclass(frozen=True)
class Disagreement:
    """One tested group of measurements. mean: average residual (CGS); p, q: p-value, false-discovery-adjusted."""

    location: str
    quantity: str
    statistic: str
    condition: str
    phase: tuple[float, float] | None
    mean: float
    score: float
    p: float
    q: float


@dataclass(frozen=True)
class Strain:
    """A nuisance parameter against its prior. moved: prior standard deviations; score: over the spread that the prior
    and the noise let it have; p: adjusted for the number of parameters (Bonferroni).
    """

    name: str
    moved: float
    score: float
    p: float


@dataclass(frozen=True)
class Located:
    """Result of the first step: the global test, all groups and all nuisance parameters, most significant first."""

    p: float
    tests: dict[str, float]
    groups: list[Disagreement]
    strains: list[Strain]

    def alarm(self, level: float) -> bool:
        return self.p < level

    def with_test(self, name: str, p: float) -> "Located":
        """With one more test in the global one: the least p-value times the number of tests."""
        tests = {**self.tests, name: min(1.0, float(p))}
        return replace(self, p=min(1.0, len(tests) * min(tests.values())), tests=tests)


def locate(problem: Problem, fit: Fit) -> Located:
    """Test the fitted rows of a problem against the recalibrated model.

    Under the model the score u = P e0 has covariance P (see `inference`), so W'u has covariance W'PW for any shapes W:
    nuisance parameters that recalibration moved, and how far the prior lets them, are accounted for exactly in the
    linear case. The global test takes the least of four p-values, times four: all residuals, their smooth part
    (mean and three harmonics of each series), the worst single series and the worst nuisance parameter (Bonferroni).
    """
    score = fit.score
    total = stats.chi2.sf(fit.objective, len(fit.residual))
    shapes, owners = _shapes(problem)
    inner = shapes.T @ fit.project(shapes)
    moved = shapes.T @ score
    smooth = _chi2(inner, moved)
    each = []
    for owner in np.unique(owners):
        mine = np.flatnonzero(owners == owner)
        each.append(_chi2(inner[np.ix_(mine, mine)], moved[mine]))
    worst = min(1.0, min(each) * len(each))
    strains = _strains(problem, fit)
    tests = {
        "all residuals": float(total),
        "smooth part": float(smooth),
        "worst series": float(worst),
        "worst nuisance parameter": min((one.p for one in strains), default=1.0),
    }
    return Located(min(1.0, len(tests) * min(tests.values())), tests, _groups(problem, fit, score), strains)


def _strains(problem: Problem, fit: Fit) -> list[Strain]:
    """Prior-data conflict (Evans & Moshonov 2006): under the model the most probable z has covariance I - C, C that of
    the posterior."""
    learnt = 1.0 - np.diag(fit.covariance)[: problem.count]
    own = [k for k, n in enumerate(problem.forward.nuisances) if n.shape is None and learnt[k] > LEAST_LEARNT]
    found = []
    for k in own:
        score = float(fit.z[k] / np.sqrt(learnt[k]))
        p = min(1.0, 2.0 * float(stats.norm.sf(abs(score))) * len(own))
        found.append(Strain(problem.forward.nuisances[k].name, float(fit.z[k]), score, p))
    return sorted(found, key=lambda one: -abs(one.score))


def _chi2(covariance: np.ndarray, vector: np.ndarray) -> float:
    """p-value of v' C^+ v against chi-squared with rank(C) degrees of freedom."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-6 * max(values[-1], 1e-300)
    rotated = vectors[:, kept].T @ vector
    return float(stats.chi2.sf(np.sum(rotated**2 / values[kept]), kept.sum()))


def _rows(problem: Problem):
    """Fitted rows of each series: (series number, positions among the fitted rows, phases or None)."""
    owner = problem.owner[problem.train]
    offsets = np.concatenate([np.arange(s.value.size) for s in problem.forward.measured])[problem.train]
    for number, series in enumerate(problem.forward.measured):
        mine = np.flatnonzero(owner == number)
        if mine.size:
            phase = None if series.time is None else (series.time[offsets[mine]] / series.period) % 1.0
            yield number, mine, phase


def _shapes(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Smooth shapes of a residual in whitened numbers, (N, k), and the series that each belongs to."""
    sd = problem.sd[problem.train]
    columns, owners = [], []
    for number, mine, phase in _rows(problem):
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


def _groups(problem: Problem, fit: Fit, score: np.ndarray) -> list[Disagreement]:
    sd = problem.sd[problem.train]
    residual = fit.residual * sd
    keys, columns = [], []
    for number, mine, phase in _rows(problem):
        if phase is None:
            bins = [(None, mine)]
        else:
            edges = np.arange(BINS + 1) / BINS
            parts = [(float(a), float(b)) for a, b in zip(edges, edges[1:], strict=False)]
            bins = [((a, b), mine[(phase >= a) & (phase < b)]) for a, b in parts]
        for part, rows in bins:
            if rows.size:
                column = np.zeros(len(sd))
                column[rows] = 1.0 / sd[rows]
                keys.append((number, part, float(residual[rows].mean())))
                columns.append(column)
    matrix = np.array(columns).T
    variance = np.einsum("ij,ij->j", matrix, fit.project(matrix))
    z = (matrix.T @ score) / np.sqrt(np.maximum(variance, 1e-300))
    p = 2.0 * stats.norm.sf(np.abs(z))
    q = false_discovery(p)
    series = problem.forward.measured
    found = [
        Disagreement(
            series[i].location,
            series[i].quantity,
            series[i].statistic,
            series[i].condition,
            part,
            mean,
            float(z[k]),
            float(p[k]),
            float(q[k]),
        )
        for k, (i, part, mean) in enumerate(keys)
    ]
    return sorted(found, key=lambda g: -abs(g.score))


def false_discovery(p: np.ndarray) -> np.ndarray:
    """p-values adjusted for the false-discovery rate (Benjamini & Yekutieli 2001, valid under any dependence)."""
    p = np.asarray(p, dtype=float)
    m = p.size
    order = np.argsort(p)
    harmonic = np.sum(1.0 / np.arange(1, m + 1))
    adjusted = p[order] * m * harmonic / np.arange(1, m + 1)
    found = np.empty(m)
    found[order] = np.minimum(1.0, np.minimum.accumulate(adjusted[::-1])[::-1])
    return found
