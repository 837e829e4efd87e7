"""Every candidate weighed from a few runs about one point, with the nuisance parameters recalibrated linearly."""

from collections import Counter

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import chi2_tail
from coronaryuq.discrepancy.selection.candidates import Candidate

LEAST_SENSITIVITY, LARGEST = 0.3, 2.0
"""Whitened norm below which data cannot see an effect, and the size at which it has to be above that, in prior standard
deviations."""
PROMISING = 40
"""Candidates whose larger sizes are run too, by the score test: so many of those of which data see a small size, and of
those of which they would see a larger one only."""
POSITIVE, SIGNED = (-1.0, 0.3, 1.6), (0.3, 1.2, -1.2)
"""Sizes that are run, in prior standard deviations; the first is that of the score test."""
TURNING = (0.3, -0.3, 0.6, -0.6, 1.2, -1.2, 2.0, -2.0)
"""Those of an effect that turns with its size, all of them tested: of a half or twice its size they tell little."""
REACH = np.exp(np.linspace(np.log(1.0 / 3.0), np.log(3.0), 61))
"""Multiples of a run's response that stand for the sizes between the runs."""
ANEW, ANEW_OF_EACH = 150, 5
"""Candidates that are run anew where all responses are known about another point: so many of all, and of each effect.
"""
NEARER = (0.95, 0.8, 0.5)
"""Shares of the way from the prior's mean to a point where the model does not run, at which it is tried instead."""


def screen(problem: Problem, at: Fit, hypothesis: Hypothesis, candidates: list[Candidate]) -> None:
    """Set `z_score`, `p_varying`, `estimate` and `guess` of all candidates from runs of a few sizes about `at`.

    Score test: g'u / sqrt(g'Pg) with g the response to a small size, u the score and P the marginal precision of the
    present model (Rao 1948); sizes that are positive by nature count only in their own direction. Estimate: log
    evidence of the model with the candidate, linear in the nuisance parameters but not in the candidate's size: a
    strong effect and the distortion that recalibration made of it are not small changes. Of an effect that turns with
    its size the best of the score tests of all sizes counts (Bonferroni). The score test of a varying size is that of
    one size for each condition, of either sign: what comes and goes is seen by it, and by no other.

    A candidate that comes with its response about another point is weighed with that, and run anew if it may matter:
    what an effect does changes little from one point to the next.

    Where the model does not run at `at`, a point nearer the prior's mean stands for it; where it runs at none, every
    candidate is left without a score.
    """
    at = _runs_at(problem, at, hypothesis)
    if at is None:
        for candidate in candidates:
            candidate.clear_score()
        return
    linear = _Linear(at, problem.condition[problem.train])
    known, first = [], []
    for candidate in candidates:
        seen = candidate.response is not None and np.isfinite(candidate.response).all()
        (known if seen else first).append(candidate)
    for candidate in known:
        linear.test(candidate)
    first += _worth_running(known)
    responses = _responses(problem, at, hypothesis, [(c, _sizes(c)[0]) for c in first])
    for candidate, response in zip(first, responses, strict=True):
        candidate.response = response
        linear.test(candidate)
    turning = [c for c in first if c.effect.changes_shape]
    ranked = sorted((c for c in first if not c.effect.changes_shape and c.z_score > 2.0), key=lambda c: -c.z_score)
    clear, faint = ([c for c in ranked if linear.sees(c.response) is so][:PROMISING] for so in (True, False))
    larger = [(c, size) for c in (*turning, *clear, *faint) for size in _sizes(c)[1:]]
    responses = _responses(problem, at, hypothesis, larger)
    scores: dict[PlacedEffect, list[float]] = {c.placed: [c.z_score] for c in turning}
    for (candidate, size), response in zip(larger, responses, strict=True):
        linear.weigh(candidate, size, response)
        if candidate.placed in scores:
            scores[candidate.placed].append(abs(linear.score_of(response, _growth(candidate, size))))
    for candidate in turning:
        candidate.z_score = _best_of(scores[candidate.placed])


def _worth_running(known: list[Candidate]) -> list[Candidate]:
    """Those that promise most, the best of each effect, by their responses about another point, and all that turn."""
    ranked, seen = sorted(known, key=lambda c: -c.promise), Counter()
    chosen = []
    for number, candidate in enumerate(ranked):
        seen[candidate.effect.name] += 1
        if number < ANEW or seen[candidate.effect.name] <= ANEW_OF_EACH or candidate.effect.changes_shape:
            chosen.append(candidate)
    return chosen


def _runs_at(problem: Problem, at: Fit, hypothesis: Hypothesis) -> Fit | None:
    """The point nearest to `at`, on the way to the prior's mean of the nuisance parameters, where the model runs."""
    for share in (1.0, *NEARER):
        point = np.concatenate([share * hypothesis.nuisances(at.z), hypothesis.all_sizes(at.z)])
        residual = problem.fitted([(point, hypothesis)])[0]
        if np.isfinite(residual).all():
            return Fit(point, residual, at.jacobian)
    return None


def _sizes(candidate: Candidate) -> tuple[float, ...]:
    if candidate.effect.changes_shape:
        return TURNING
    return POSITIVE if candidate.one_sided else SIGNED


def _growth(candidate: Candidate, size: float) -> float:
    """How many times an effect of size z would be at the largest size, were it in proportion; 1 for one that turns."""
    if candidate.effect.changes_shape:
        return 1.0
    if candidate.one_sided:
        return float(np.exp(candidate.effect.parameters[0].spread * (LARGEST - size)))
    return LARGEST / abs(size)


def _responses(problem: Problem, at: Fit, hypothesis: Hypothesis, wanted: list[tuple[Candidate, float]]) -> np.ndarray:
    """Change (n, N) of whitened predictions by each (candidate, size z) wanted."""
    if not wanted:
        return np.zeros((0, len(at.residual)))
    rows = []
    for candidate, size in wanted:
        sizes = np.full(len(candidate.effect.parameters), size)
        rows.append((np.concatenate([at.z, sizes]), hypothesis.with_(candidate.placed)))
    grafts = [
        placed for placed in dict.fromkeys([*hypothesis, *(c.placed for c, _ in wanted)]) if placed.effect.grafted
    ]
    return at.residual - problem.fitted(rows, grafts)


class _Linear:
    """The present model about one point, linear in its parameters: what responses of candidates are weighed against."""

    def __init__(self, at: Fit, conditions: np.ndarray):
        linear = at.residual + at.jacobian @ at.z
        self.project = at.projection
        self.score = self.project(linear)
        self.apart = conditions[:, None] == np.unique(conditions)
        self.evidence = -0.5 * float(linear @ self.score) - 0.5 * float(np.linalg.slogdet(at.precision)[1])

    def test(self, candidate: Candidate) -> None:
        """The score tests, and a first weighing, by the response to a small size."""
        candidate.clear_score()
        response = candidate.response
        if np.isfinite(response).all():
            z = self.score_of(response, _growth(candidate, _sizes(candidate)[0]))
            candidate.z_score = max(z, 0.0) if candidate.one_sided else abs(z)
            if z != 0.0 and self.apart.shape[1] > 1:
                each = response[:, None] * self.apart
                candidate.p_varying = chi2_tail(each.T @ self.project(each), each.T @ self.score)
            self.weigh(candidate, _sizes(candidate)[0], response)

    def sees(self, response: np.ndarray, growth: float = 1.0) -> bool:
        """Whether data see what is `growth` times as large as this response."""
        return self._length(response) * growth > LEAST_SENSITIVITY

    def score_of(self, response: np.ndarray, growth: float) -> float:
        """The score test's standard normal number of one response; nought where data do not see it however large."""
        if not np.isfinite(response).all() or not self.sees(response, growth):
            return 0.0
        return float(response @ self.score) / self._length(response)

    def _length(self, response: np.ndarray) -> float:
        """Whitened norm of what the nuisance parameters leave of a response."""
        return float(np.sqrt(max(response @ self.project(response), 0.0)))

    def weigh(self, candidate: Candidate, size: float, response: np.ndarray) -> None:
        """Let the candidate have the greatest log evidence that multiples of this response reach, if it is greater."""
        if not np.isfinite(response).all():
            return
        along, square = float(response @ self.score), float(response @ self.project(response))
        gain, best = _best_size(candidate, size, along, max(square, 0.0))
        if self.evidence + gain > candidate.estimate:
            candidate.estimate = self.evidence + gain
            candidate.guess = np.full(len(candidate.effect.parameters), np.clip(best, -2.5, 2.5))


def _best_of(scores: list[float]) -> float:
    """The standard normal number that stands for the best of n score tests: its tail is n times that of the best, or
    more (Bonferroni, by the tail's leading term)."""
    return float(np.sqrt(max(max(scores) ** 2 - 2.0 * np.log(len(scores)), 0.0)))


def _best_size(candidate: Candidate, size: float, along: float, square: float) -> tuple[float, float]:
    """Greatest log evidence over the present model, and the size z, among multiples of the response to one size.

    In 2 log Z the response a d changes the misfit by a^2 d'Pd - 2 a d'u, the prior by -z^2 (two sizes of one effect
    move together, with the prior of one), and the determinant by 1 + g'Pg with g the slope of a d in z.
    """
    if candidate.one_sided:
        spread = candidate.effect.parameters[0].spread
        sizes, slope = size + np.log(REACH) / spread, spread * REACH
    else:
        sizes, slope = size * REACH, np.full(len(REACH), 1.0 / size)
    gains = REACH * along - 0.5 * REACH**2 * square - 0.5 * sizes**2 - 0.5 * np.log1p(slope**2 * square)
    best = int(np.argmax(gains))
    return float(gains[best]), float(sizes[best])
