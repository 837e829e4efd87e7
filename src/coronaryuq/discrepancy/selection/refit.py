"""Fits of candidates together with other effects: approximate, in full if they compete, repeated if they diverged."""

from collections.abc import Collection, Iterable
from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Candidate, best_of_effects, least_weight, updated


def fit_shortlist(
    problem: Problem,
    base: Fit,
    hypothesis: Hypothesis,
    candidates: list[Candidate],
    point: Fit,
    from_point: Collection[PlacedEffect] = (),
) -> list[Candidate]:
    """Fit candidates from the fit of the present hypothesis with its sensitivities frozen, then the best in full.

    If even the best leaves the prior, so large a misfit remains that a fit may have ended anywhere: contenders for the
    first effect are then also fitted from other starting points, as are promising candidates whose fit diverged.
    base: that fit. from_point: those fitted from another point instead.
    """
    fits: dict[PlacedEffect, Fit | None] = {}
    for about, elsewhere in ((base, False), (point, True)):
        own = [c for c in candidates if (c.placed in from_point) is elsewhere]
        placed, starts = [c.placed for c in own], [c.rough or c.start for c in own]
        fits |= zip(placed, problem.fit_candidates(about, hypothesis, placed, starts), strict=True)
    candidates = _with_fits(candidates, [fits[c.placed] for c in candidates])
    contenders = _contenders(candidates, base)
    candidates = updated(candidates, _with_fits(contenders, _in_full(problem, hypothesis, contenders)))
    contenders = _contenders(candidates, base)
    again = contenders if contenders and not hypothesis and problem.distorted(contenders[0].fitted) else []
    least = contenders[0].log_weight - RULE.contender_gap if contenders else -np.inf
    again = list({c.placed: c for c in (*again, *diverged(candidates, least, base.evidence))}.values())
    return updated(candidates, from_other_starts(problem, hypothesis, again))


def fit_each(
    problem: Problem,
    hypothesis: Hypothesis,
    candidates: list[Candidate],
    point: Fit,
    least: float = -np.inf,
    without: float = -np.inf,
) -> list[Candidate]:
    """Fit candidates from a point with its sensitivities frozen, and in full those that weigh more than `least`.

    without: log evidence of the other effects alone, below which a fit has diverged and is repeated from other points.
    """
    candidates = _with_fits(candidates, quick_fits(problem, hypothesis, candidates, point))
    close = [c for c in candidates if c.log_weight > least]
    full = [fit or c.fit for c, fit in zip(close, _in_full(problem, hypothesis, close), strict=True)]
    candidates = updated(candidates, _with_fits(close, full))
    again = diverged(candidates, least, without)
    return updated(candidates, from_other_starts(problem, hypothesis, again))


def diverged(candidates: Iterable[Candidate], least: float, without: float) -> list[Candidate]:
    """Return those that promise more than `least` but whose fit is worse than without any effect.

    A size near zero would fit better, so the fit diverged, perhaps because other sizes compensate for the part that
    this effect explains. Only the best place of each effect, because screening about its fit finds the others.
    """
    worse = [
        c
        for c in candidates
        if c.promise > least and c.fit is not None and c.fit.evidence < without - RULE.diverged_gap
    ]
    return best_of_effects(sorted(worse, key=lambda c: -c.promise), RULE.diverged_refits)


def from_other_starts(problem: Problem, hypothesis: Hypothesis, candidates: list[Candidate]) -> list[Candidate]:
    """Replace the fits of candidates by better ones that start from the prior mean."""
    new = [c for c in candidates if c.multistart is None]
    fits = dict(zip(new, problem.multistart_each([hypothesis.with_(c.placed) for c in new]), strict=True))
    refitted = []
    for candidate in candidates:
        other = candidate.multistart or fits[candidate]
        better = other is not None and other.evidence > candidate.fitted.evidence
        refitted.append(replace(candidate, multistart=other, fit=other if better else candidate.fit))
    return refitted


def with_own_time_steps(problem: Problem, hypothesis: Hypothesis, candidates: list[Candidate]) -> list[Candidate]:
    """Fit candidates again, each with the time-step error corrected at its own fit."""
    corrected = [problem.corrected(hypothesis.with_(c.placed), c.fitted) for c in candidates]
    return _with_fits(candidates, [fit for _, fit in corrected])


def quick_fits(problem: Problem, hypothesis: Hypothesis, candidates: list[Candidate], point: Fit) -> list[Fit | None]:
    """Fit candidates from a point and their guesses, with all other sensitivities frozen."""
    starts = [c.rough or c.start for c in candidates]
    return problem.fit_roughly(point, hypothesis, [c.placed for c in candidates], starts)


def fit_class(
    problem: Problem,
    hypothesis: Hypothesis,
    candidates: list[Candidate],
    point: Fit,
    ahead: Candidate,
    members: Collection[PlacedEffect] = (),
) -> list[Candidate]:
    """Fit candidates that may be in the class of another; return those that could be fitted, the best of all in full.

    There may be many more than are fitted in full after screening: each segment of one vessel, for example, or every
    pair of outlets. All sensitivities except those to their own sizes stay those of `point`, from which they hardly
    differ. members: those that are fitted in any case.
    """
    alike = [c for c in candidates if c.placed in members or may_be_in_class(c, ahead)]
    found = [c for c in _with_fits(alike, quick_fits(problem, hypothesis, alike, point)) if c.fit is not None]
    best = max([ahead, *found], key=lambda c: c.log_weight)
    if best.placed == ahead.placed:
        return found
    full = exact(problem, hypothesis.with_(best.placed), best.fitted.z)
    return updated(found, [replace(best, fit=full or best.fit)])


def exact(problem: Problem, hypothesis: Hypothesis, start: np.ndarray | None = None) -> Fit | None:
    """Fit a hypothesis in full; None if the model does not run at the start."""
    return problem.calibrate_each([(hypothesis, start)])[0]


def without_each(
    problem: Problem, hypothesis: Hypothesis, fit: Fit, removed: Iterable[PlacedEffect]
) -> list[Fit | None]:
    """Fit the model without each of some effects in turn; None if it does not run.

    From the prior's mean and from the fit with the effect, whichever is better: a poor fit would flatter the effect.
    """
    wanted: list[tuple[Hypothesis, np.ndarray | None]] = []
    for placed in removed:
        others = hypothesis.without(placed)
        wanted += [(others, None), (others, drop(fit, hypothesis.columns(fit.z, placed)).z)]
    fits = problem.calibrate_each(wanted)
    pairs = ([fit for fit in fits[k : k + 2] if fit is not None] for k in range(0, len(fits), 2))
    return [max(pair, key=lambda fit: fit.evidence, default=None) for pair in pairs]


def may_be_in_class(candidate: Candidate, best: Candidate) -> bool:
    """Return whether a candidate's estimate about the best one's fit may put it in the same class."""
    gap = min(best.log_weight - candidate.promise, best.fitted.evidence - candidate.estimate)
    return gap < RULE.class_odds + RULE.class_margin


def point_without(candidate: Candidate) -> Fit:
    """Return the point of a candidate's fit without its own sizes."""
    fit = candidate.fitted
    return drop(fit, Hypothesis((candidate.placed,)).columns(fit.z, candidate.placed))


def drop(fit: Fit, columns: slice) -> Fit:
    """Return the point of a fit without some of its parameters."""
    z, jacobian = np.delete(fit.z, columns), np.delete(fit.jacobian, columns, axis=1)
    return Fit(z, fit.residual, jacobian, flexible=fit.flexible)


def _in_full(problem: Problem, hypothesis: Hypothesis, candidates: list[Candidate]) -> list[Fit | None]:
    return problem.calibrate_each([(hypothesis.with_(c.placed), c.fitted.z) for c in candidates])


def _with_fits(candidates: list[Candidate], fits: list[Fit | None]) -> list[Candidate]:
    return [replace(candidate, fit=fit) for candidate, fit in zip(candidates, fits, strict=True)]


def _contenders(candidates: list[Candidate], base: Fit) -> list[Candidate]:
    """Return the best of those that were fitted, a limited number and none too far behind the first."""
    ranked = sorted((c for c in candidates if c.fit is not None), key=lambda c: -c.log_weight)
    return [c for c in ranked[: RULE.full_fits] if c.log_weight > least_weight(ranked[0], base)]
