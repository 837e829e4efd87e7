"""Effects to which a model without them adapts: exchanged channels, and values that are recalibrated.

A model without an exchange is recalibrated to the wrong channels. About that fit an exchange looks wrong, because the
parameters would have to move back with it, and what they then move is the other channel: it is screened with the slopes
of the exchanged predictions. Other effects are recalibrated parameters far outside their prior. Recalibration has moved
the other parameters instead; they must move back a long way, although predictions hardly change.
"""

from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Candidate


@dataclass(frozen=True, eq=False)
class Exchange:
    """Fitted rows (M,) between which each is interpolated, itself outside the two channels, and the latter's share."""

    before: np.ndarray
    after: np.ndarray
    share: np.ndarray

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return values (M, ...) as they are after the exchange."""
        return (values[self.before].T * (1.0 - self.share) + values[self.after].T * self.share).T


def exchange(problem: Problem, candidate: Candidate) -> Exchange | None:
    """Return the exchange of rows to which a candidate amounts; None if it is none, or one channel has no partner."""
    if not candidate.effect.exchanges:
        return None
    measured, anatomy = problem.forward.measured, problem.forward.anatomy
    number_of = {(s.quantity, s.location, s.statistic, s.condition): number for number, s in enumerate(measured)}
    before, share = np.arange(len(problem.y)), np.zeros(len(problem.y))
    after = before.copy()
    for number, one in enumerate(measured):
        if place := candidate.effect.elsewhere(candidate.place, one, anatomy):
            other = number_of.get((*place, one.statistic, one.condition))
            if other is None:
                return None
            own, rows = problem.owner == number, np.flatnonzero(problem.owner == other)
            first, share[own] = _between(one, measured[other])
            before[own], after[own] = rows[first], rows[(first + 1) % len(rows)]
    fitted = np.flatnonzero(problem.train)
    before, after = (np.searchsorted(fitted, rows[problem.train]) for rows in (before, after))
    return Exchange(before, after, share[problem.train])


def _between(one: Measured, other: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Return the last sample of another series before each of one (k,), and how far on to the next one that is."""
    if one.time is None or other.time is None:
        return np.zeros(1, dtype=int), np.zeros(1)
    first = (np.searchsorted(other.time, one.time, side="right") - 1) % len(other.time)
    gap = np.roll(other.time, -1)[first] - other.time[first]
    return first, ((one.time - other.time[first]) % one.period) / np.where(gap > 0.0, gap, gap + one.period)


def about(problem: Problem, point: Fit, candidate: Candidate, size: float) -> Fit | None:
    """Return a point with an effect to which the model adapts, linearised with the slopes there; None for others.

    size: z at which the candidate's response was run.
    """
    if candidate.response is not None and candidate.effect.recalibrated:
        slopes = np.column_stack([point.jacobian, candidate.response / size])
        return Fit(np.append(point.z, 0.0), point.residual, slopes, flexible=point.flexible)
    if candidate.response is None or (found := exchange(problem, candidate)) is None:
        return None
    sd, constant = problem.sd[problem.train][:, None], problem.linear_part()[0]
    slopes = found.of(point.jacobian * sd) / sd
    slopes[:, constant] = point.jacobian[:, constant]
    # The response grows as the share does, which is lognormal.
    slopes = np.column_stack([slopes, candidate.effect.parameters[0].spread * candidate.response])
    z = np.concatenate([point.z, candidate.at_size(size)])
    return Fit(z, point.residual - candidate.response, slopes, flexible=point.flexible)


def weighed(
    problem: Problem, point: Fit, hypothesis: Hypothesis, candidates: list[Candidate], sizes: list[float]
) -> list[Candidate]:
    """Return candidates screened at some sizes z; those of `about` have a rough fit where that promises more."""
    each = {c.placed: about(problem, point, c, size) for c, size in zip(candidates, sizes, strict=True)}
    least = max((c.estimate for c in candidates), default=0.0) - RULE.far_behind
    ran = {placed: fit for placed, fit in each.items() if fit and np.isfinite(fit.residual).all()}
    # The whole way to the linear optimum, which is where the parameters were before they adapted.
    optima = {p: replace(fit, z=fit.promised.moments()[0]) for p, fit in ran.items() if fit.promised.right > least}
    rough = dict(zip(optima, problem.fit_roughly(point, hypothesis, [*optima], [*optima.values()]), strict=True))
    better = {c.placed: fit for c in candidates if (fit := rough.get(c.placed)) and fit.evidence > c.estimate}
    candidates = [replace(c, rough=better.get(c.placed)) for c in candidates]
    return [replace(c, estimate=c.rough.evidence, guess=float(c.rough.z[-1])) if c.rough else c for c in candidates]
