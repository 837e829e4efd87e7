"""Score test (Rao 1948) and estimate of every candidate from a few runs about one point."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from coronaryuq.core.chi_squared import best_of, chi2_tail
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.flexible import RIGHT, Flexible, Projection
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.adapted import weighed
from coronaryuq.discrepancy.selection.candidates import Candidate

POSITIVE, SIGNED = (-1.0, 0.3, 1.6), (0.3, 1.2, -1.2)
"""Sizes that are run, in prior standard deviations; the score test uses the first."""
SHAPE_CHANGING = (0.3, -0.3, 0.6, -0.6, 1.2, -1.2, 2.0, -2.0)
"""Sizes of an effect whose shape changes with its size; all are tested, because one does not predict the others."""
MULTIPLES = np.exp(np.linspace(np.log(1.0 / 3.0), np.log(3.0), 61))
"""Multiples of a run's response that represent the sizes between the runs."""
SLOPE = (0.02,)
"""Size of an effect that a recalibrated parameter has as well: whatever its size, only their slopes are compared."""
NEARER = (0.95, 0.8, 0.5)
"""Fractions of the way from the prior mean to a point where the model does not run, at which it is tried instead."""


def screen(problem: Problem, point: Fit, hypothesis: Hypothesis, candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates with score, estimate and guess from runs of a few sizes about a point.

    Score test: g'u / sqrt(g'Pg) with g the response to a small size, u the score and P the marginal precision of the
    present model; for sizes that are positive by nature only their own direction counts. Estimate: log evidence with
    the candidate, linear in the nuisance parameters but not in its size: a strong effect, and the distortion by which
    recalibration compensates it, are not small changes. For an effect whose shape changes with its size, the best score
    test of all sizes counts (Bonferroni). The test of a varying size has one size per condition, of either sign: no
    other test detects an effect that is present in some conditions only.

    A known response about another point is used unchanged, and run again only if it may matter: it changes little from
    one point to the next. If the model does not run at the point, one nearer to the prior mean is used; if it runs at
    none, every candidate is left without a score.
    """
    runnable = nearest_runnable(problem, point, hypothesis)
    if runnable is None:
        return [_unscored(c) for c in candidates]
    linear = _LinearModel(runnable, problem.condition[problem.train], problem.flexible)
    scored = {c.placed: linear.test(c) for c in candidates if c.response is not None and np.isfinite(c.response).all()}
    run = [c for c in candidates if c.placed not in scored] + _worth_rerunning(scored.values())
    responses = _responses(problem, runnable, hypothesis, [(c, first_size(c)) for c in run])
    run = [linear.test(replace(c, response=response)) for c, response in zip(run, responses, strict=True)]
    run = weighed(problem, runnable, hypothesis, run, [first_size(c) for c in run])
    scored |= {c.placed: c for c in run}
    shape_changing = [c for c in run if c.effect.changes_shape]
    ranked = sorted(
        (c for c in run if not c.effect.changes_shape and c.z_score > RULE.shortlist_score), key=lambda c: -c.z_score
    )
    clear = [c for c in ranked if linear.sees(c)][: RULE.larger_sizes]
    faint = [c for c in ranked if not linear.sees(c)][: RULE.larger_sizes]
    larger = [(c, size) for c in (*shape_changing, *clear, *faint) for size in _sizes(c)[1:]]
    responses = _responses(problem, runnable, hypothesis, larger)
    z_scores: dict[PlacedEffect, list[float]] = {c.placed: [c.z_score] for c in shape_changing}
    for (candidate, size), response in zip(larger, responses, strict=True):
        scored[candidate.placed] = linear.weigh(scored[candidate.placed], size, response)
        if candidate.placed in z_scores:
            z_scores[candidate.placed].append(abs(linear.z_score(candidate, response, size)))
    for placed, values in z_scores.items():
        scored[placed] = replace(scored[placed], z_score=best_of(values))
    # Responses to a strong effect are not proportional to its size, so the best candidates are run at their estimates.
    likeliest = sorted((c for c in scored.values() if c.guess), key=lambda c: -c.promise)[: RULE.larger_sizes]
    responses = _responses(problem, runnable, hypothesis, [(c, c.guess) for c in likeliest])
    for candidate, response in zip(likeliest, responses, strict=True):
        scored[candidate.placed] = linear.weigh(candidate, candidate.guess, response)
    return [scored[c.placed] for c in candidates]


def _unscored(candidate: Candidate) -> Candidate:
    return replace(candidate, z_score=0.0, p_varying=1.0, signal=0.0, estimate=-np.inf, guess=0.0)


def _worth_rerunning(known: Iterable[Candidate]) -> list[Candidate]:
    """Return the most promising by their known responses, the best of each effect, and all that change shape or place.

    What a probe reads elsewhere may differ much from one point to the next.
    """
    ranked, seen = sorted(known, key=lambda c: -c.promise), Counter[str]()
    chosen = []
    for number, candidate in enumerate(ranked):
        seen[candidate.effect.name] += 1
        always = candidate.effect.changes_shape or candidate.effect.reads_elsewhere
        if number < RULE.rerun or seen[candidate.effect.name] <= RULE.rerun_per_effect or always:
            chosen.append(candidate)
    return chosen


def nearest_runnable(problem: Problem, point: Fit, hypothesis: Hypothesis) -> Fit | None:
    """Return the nearest point towards the prior's mean of the nuisance parameters at which the model runs."""
    for share in (1.0, *NEARER):
        z = np.concatenate([share * hypothesis.nuisances(point.z), hypothesis.all_sizes(point.z)])
        residual = problem.fitted([(z, hypothesis)])[0]
        if np.isfinite(residual).all():
            return Fit(z, residual, point.jacobian, flexible=point.flexible)
    return None


def first_size(candidate: Candidate) -> float:
    """Return the size z of the response that a screened candidate has."""
    return _sizes(candidate)[0]


def _sizes(candidate: Candidate) -> tuple[float, ...]:
    if candidate.effect.changes_shape or candidate.effect.recalibrated:
        return SHAPE_CHANGING if candidate.effect.changes_shape else SLOPE
    return POSITIVE if candidate.one_sided else SIGNED


def _growth(candidate: Candidate, size: float, target: float = RULE.visible_size) -> float:
    """Return the ratio of a target size, by default the largest visible one, to size z."""
    if candidate.one_sided:
        return float(np.exp(candidate.effect.parameters[0].spread * (target - size)))
    return target / abs(size)


def _responses(
    problem: Problem, point: Fit, hypothesis: Hypothesis, wanted: list[tuple[Candidate, float]]
) -> np.ndarray:
    """Return the change (n, N) of whitened predictions by each (candidate, size z)."""
    if not wanted:
        return np.zeros((0, len(point.residual)))
    rows = [(np.concatenate([point.z, c.at_size(size)]), hypothesis.with_(c.placed)) for c, size in wanted]
    effects = dict.fromkeys([*hypothesis, *(c.placed for c, _ in wanted)])
    return point.residual - problem.fitted(rows, [placed for placed in effects if placed.effect.grafted])


class _LinearModel:
    """The present model, linearised about one point, for the weights of candidates."""

    def __init__(self, point: Fit, conditions: np.ndarray, flexible: Flexible):
        self.project, self.score = point.projection, point.score
        self.by_condition = conditions[:, None] == np.unique(conditions)
        self.model = Projection(flexible, point.jacobian)
        self.data = self.model.weighted(point.at_zero)
        self.log_evidence = self.model.condition(self.data)[0] + RIGHT

    def test(self, candidate: Candidate) -> Candidate:
        """Return the candidate with its score tests, and a first estimate, by its response to a small size."""
        candidate, response, size = _unscored(candidate), candidate.response, first_size(candidate)
        if response is None or not np.isfinite(response).all():
            return candidate
        z = self.z_score(candidate, response, size)
        signal = self._length(response) * _growth(candidate, size, candidate.typical)
        candidate = replace(candidate, z_score=max(z, 0.0) if candidate.one_sided else abs(z), signal=signal)
        if z != 0.0 and self.by_condition.shape[1] > 1:
            each = response[:, None] * self.by_condition
            candidate = replace(candidate, p_varying=chi2_tail(each.T @ self.project(each), each.T @ self.score))
        return self.weigh(candidate, size, response)

    def sees(self, candidate: Candidate) -> bool:
        """Return whether the data can detect a candidate's response to a small size."""
        return candidate.response is not None and self._length(candidate.response) > RULE.visible_response

    def z_score(self, candidate: Candidate, response: np.ndarray, size: float) -> float:
        """Return the score test's standard normal number; zero if not even the largest visible size shows.

        Of an effect whose shape changes with its size, each size stands for itself.
        """
        length = self._length(response) if np.isfinite(response).all() else 0.0
        growth = 1.0 if candidate.effect.changes_shape else _growth(candidate, size)
        return float(response @ self.score) / length if length * growth > RULE.visible_response else 0.0

    def _length(self, response: np.ndarray) -> float:
        """Return the whitened norm of the part of a response that recalibration cannot absorb."""
        return float(np.sqrt(max(response @ self.project(response), 0.0)))

    def weigh(self, candidate: Candidate, size: float, response: np.ndarray) -> Candidate:
        """Return the candidate with the largest log evidence that multiples of a response reach, if it is larger."""
        if not np.isfinite(response).all():
            return candidate
        weighted = self.model.weighted(response)
        along, square = self.model.inner(weighted, self.data), self.model.inner(weighted, weighted)
        estimate, best = _best_size(candidate, size, self.log_evidence, along, np.maximum(square, 0.0))
        if estimate > candidate.estimate:
            return replace(candidate, estimate=estimate, guess=float(np.clip(best, -2.5, 2.5)))
        return candidate


def _best_size(
    candidate: Candidate, size: float, log_evidence: np.ndarray, along: np.ndarray, square: np.ndarray
) -> tuple[float, float]:
    """Return the largest log evidence, and its size z, among multiples of the response to one size.

    log_evidence: without the candidate, by amplitude of the model's own error (T,); along, square: d'Pu and d'Pd of the
    response d. In 2 log Z the response a d changes the misfit by a^2 d'Pd - 2 a d'Pu, the prior by -z^2, and the
    determinant by 1 + g'Pg with g the slope of a d in z.
    """
    if candidate.one_sided:
        spread = candidate.effect.parameters[0].spread
        sizes, slope = size + np.log(MULTIPLES) / spread, spread * MULTIPLES
    else:
        sizes, slope = size * MULTIPLES, np.full(len(MULTIPLES), 1.0 / size)
    along, square = along[:, None], square[:, None]
    gains = MULTIPLES * along - 0.5 * MULTIPLES**2 * square - 0.5 * sizes**2 - 0.5 * np.log1p(slope**2 * square)
    estimates = logsumexp(log_evidence[:, None] + gains, axis=0)
    best = int(np.argmax(estimates))
    return float(estimates[best]), float(sizes[best])
