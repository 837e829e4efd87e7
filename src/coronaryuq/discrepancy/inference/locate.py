"""Location of disagreements: whitened residuals by vessel, quantity, phase and condition, and conflicts with priors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.nuisance import without_noise
from coronaryuq.discrepancy.forward.pullbacks import vessels_of_readings
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import phases, residual_tests

BINS = 4
"""Phases of the cycle."""


@dataclass(frozen=True)
class Disagreement:
    """One tested group of measurements.

    mean: average residual (CGS); p, q: p-value, and adjusted for the false discovery rate (Benjamini & Yekutieli 2001,
    for any dependence).
    """

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
class PriorConflict:
    """A nuisance parameter against its prior.

    moved: prior standard deviations; score: over the spread that prior and noise allow; p: adjusted for the number of
    parameters (Bonferroni).
    """

    name: str
    moved: float
    score: float
    p: float


@dataclass(frozen=True)
class Located:
    """The global test, all groups of measurements and all nuisance parameters, most significant first."""

    p: float
    tests: dict[str, float]
    groups: list[Disagreement]
    conflicts: list[PriorConflict]

    def alarm(self, level: float) -> bool:
        """Return whether the global test is significant at a level."""
        return self.p < level

    def with_tests(self, more: Mapping[str, float]) -> "Located":
        """Add tests that it does not have to the global one: the smallest p-value times the number of tests."""
        tests = {**self.tests, **{name: min(1.0, float(p)) for name, p in more.items() if name not in self.tests}}
        return replace(self, p=min(1.0, len(tests) * min(tests.values())), tests=tests)


def locate(problem: Problem, fit: Fit) -> Located:
    """Test the fitted data against a model.

    Under the model the score u = P e0 has covariance P (see `gauss_newton`), so W'u has covariance W'PW for any shapes
    W: recalibration within the prior is accounted for exactly in the linear case. The global test takes the smallest of
    four p-values, times four: all residuals, their smooth part (mean and three harmonics of each series), the worst
    single series and the worst nuisance parameter (Bonferroni); `search.assess` adds more.
    """
    score = fit.score
    conflicts = _conflicts(problem, fit)
    tests = residual_tests(problem, problem.train, fit.objective, score, fit.projection)
    tests["worst nuisance parameter"] = min((conflict.p for conflict in conflicts), default=1.0)
    return Located(min(1.0, len(tests) * min(tests.values())), tests, _groups(problem, fit, score), conflicts)


def _conflicts(problem: Problem, fit: Fit) -> list[PriorConflict]:
    """Test each nuisance parameter for prior-data conflict (Evans & Moshonov 2006).

    Under the model the most probable z has covariance I - C, with C the posterior covariance.
    """
    learnt = 1.0 - np.diag(fit.covariance)[: problem.count]
    own = [k for k, n in enumerate(problem.forward.nuisances) if n.shape is None and learnt[k] > RULE.informed_nuisance]
    conflicts = []
    for k in own:
        score = float(fit.z[k] / np.sqrt(learnt[k]))
        p = min(1.0, 2.0 * float(stats.norm.sf(abs(score))) * len(own))
        conflicts.append(PriorConflict(problem.forward.nuisances[k].name, float(fit.z[k]), score, p))
    return sorted(conflicts, key=lambda conflict: -abs(conflict.score))


def _groups(problem: Problem, fit: Fit, score: np.ndarray) -> list[Disagreement]:
    sd = problem.sd[problem.train]
    noise = fit.z - without_noise(problem.forward.nuisances, fit.z)
    residual = (fit.residual + fit.jacobian @ noise) * sd
    tested, columns = [], []
    for number, own, phase in phases(problem, problem.train):
        series = problem.forward.measured[number]
        for location, part, rows in _parts(problem, series, own, phase):
            if rows.size:
                column = np.zeros(len(sd))
                column[rows] = 1.0 / sd[rows]
                key = location, series.quantity, series.statistic, series.condition
                tested.append((*key, part, float(residual[rows].mean())))
                columns.append(column)
    matrix = np.array(columns).T
    variance = np.einsum("ij,ij->j", matrix, fit.projection(matrix))
    z = (matrix.T @ score) / np.sqrt(np.maximum(variance, 1e-300))
    p = 2.0 * stats.norm.sf(np.abs(z))
    q = stats.false_discovery_control(p, method="by")
    scores = zip(z.tolist(), p.tolist(), q.tolist(), strict=True)
    groups = [Disagreement(*group, *score) for group, score in zip(tested, scores, strict=True)]
    return sorted(groups, key=lambda group: -abs(group.score))


Part = tuple[str, tuple[float, float] | None, np.ndarray]
"""Location, phases of the cycle if it is a part of it, and positions among the fitted rows."""


def _parts(problem: Problem, series: Measured, own: np.ndarray, phase: np.ndarray | None) -> list[Part]:
    """Divide the fitted rows of a series: a waveform by quarters of the cycle, a pullback by vessels."""
    if phase is None:
        return [(series.location, None, own)]
    if series.pullback is not None:
        # All readings of a condition are fitted, or none.
        vessels = np.array(vessels_of_readings(problem.forward.anatomy, series.pullback))
        return [(vessel, None, own[vessels == vessel]) for vessel in dict.fromkeys(vessels.tolist())]
    bounds = [(part / BINS, (part + 1) / BINS) for part in range(BINS)]
    return [(series.location, (a, b), own[(phase >= a) & (phase < b)]) for a, b in bounds]
