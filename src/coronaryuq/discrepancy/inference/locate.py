"""Where model and measurements disagree: whitened residuals by vessel, quantity, phase and condition."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.forward.nuisance import without_noise
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import phases, residual_tests

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
    (mean and three harmonics of each series), the worst single series and the worst nuisance parameter (Bonferroni);
    `search.assess` adds those of the candidates.
    """
    score = fit.score
    strains = _strains(problem, fit)
    tests = residual_tests(problem, problem.train, fit.objective, score, fit.project)
    tests["worst nuisance parameter"] = min((one.p for one in strains), default=1.0)
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


def _groups(problem: Problem, fit: Fit, score: np.ndarray) -> list[Disagreement]:
    sd = problem.sd[problem.train]
    noise = fit.z - without_noise(problem.forward.nuisances, fit.z)
    residual = (fit.residual + fit.jacobian @ noise) * sd
    keys, columns = [], []
    for number, mine, phase in phases(problem, problem.train):
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
