"""Forward step: fit the best candidates, screen again about the best fit, and accept one or none."""

from dataclasses import replace

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection import refit
from coronaryuq.discrepancy.selection.candidates import (
    Candidate,
    Round,
    best_of_effects,
    class_log_weight,
    least_weight,
    likely,
    preferred,
    shortlist,
    updated,
    with_shares,
)
from coronaryuq.discrepancy.selection.score_test import screen

Pool = dict[PlacedEffect, Candidate]
"""All candidates of a round; those that were fitted are its shortlist."""


def forward_step(
    problem: Problem, fit: Fit, hypothesis: Hypothesis, candidates: list[Candidate], point: Fit, least: float
) -> Round:
    """Fit the shortlist of scored candidates, weigh it, and accept the best if the odds of its class suffice.

    fit: of the present hypothesis, where the candidates were scored; point: another, if that is distorted, at which to
    score them as well; least: log odds that suffice.
    """
    from_point: set[PlacedEffect] = set()
    if point is not fit:
        candidates, from_point = _seen_from(problem, point, hypothesis, candidates)
    chosen = shortlist(candidates, problem.settings.shortlist, fit if hypothesis else None)
    fitted = refit.fit_shortlist(problem, fit, hypothesis, chosen, point, from_point)
    pool = {c.placed: c for c in (*candidates, *fitted)}
    for _ in range(RULE.second_looks if _fitted(pool) else 0):
        before = _best(pool)
        pool, near = look_again(problem, fit, before, hypothesis, pool)
        if (ahead := _best(pool)).placed == before.placed:
            waiting = [c for c in near if pool[c.placed].fit is None]
            for c in refit.fit_class(problem, hypothesis, waiting, refit.point_without(ahead), ahead):
                pool[c.placed] = replace(pool[c.placed], fit=c.fit)
            break
    tried = _fitted(pool)
    worth = _worth_naming(fit, tried, least)
    if not worth:
        corrected = refit.with_own_time_steps(problem, hypothesis, best_of_effects(tried, RULE.likeliest_effects))
        tried = sorted(updated(tried, corrected), key=lambda c: -c.log_weight)
        worth = _worth_naming(fit, tried, least)
    if not worth:
        return Round(with_shares(tried), None, others=hypothesis)
    return Round([], None, scored=list(pool.values())).decided(preferred(worth), tried, hypothesis)


def _fitted(pool: Pool) -> list[Candidate]:
    """Return the candidates that were fitted, best first."""
    return sorted((c for c in pool.values() if c.fit is not None), key=lambda c: -c.log_weight)


def _best(pool: Pool) -> Candidate:
    return _fitted(pool)[0]


def _worth_naming(fit: Fit, candidates: list[Candidate], least: float) -> list[Candidate]:
    """Return those whose class has the required odds over the present model."""
    return [c for c in candidates if class_log_weight(c, candidates) - fit.evidence >= least]


def _seen_from(
    problem: Problem, point: Fit, hypothesis: Hypothesis, candidates: list[Candidate]
) -> tuple[list[Candidate], set[PlacedEffect]]:
    """Score all candidates at another point, too; return them as they look better, and those that do there.

    About one point recalibration may hide what the other shows.
    """
    there = screen(problem, point, hypothesis, candidates)
    better = {c.placed for c, other in zip(candidates, there, strict=True) if other.estimate > c.estimate}
    seen = [
        replace(other if other.placed in better else c, z_score=max(c.z_score, other.z_score))
        for c, other in zip(candidates, there, strict=True)
    ]
    return seen, better


def look_again(
    problem: Problem, fit: Fit, best: Candidate, hypothesis: Hypothesis, pool: Pool
) -> tuple[Pool, list[Candidate]]:
    """Screen candidates about the fit of the best one, and shortlist those that now look as good.

    Recalibration without the right effect distorts the nuisance parameters, and about such a point a neighbour of the
    right place may look best. About the best fit so far they are nearly right, provided they are within their prior
    there. fit: of the present model. Also returns the candidates as seen from there, without those far behind.
    """
    if problem.distorted(best.fitted):
        return pool, []
    point = refit.point_without(best)
    likely_ones = [replace(c, fit=None) for c in likely(pool.values())]
    fresh = screen(problem, point, hypothesis, likely_ones)
    near = sorted((c for c in fresh if c.promise > best.log_weight - RULE.contender_gap), key=lambda c: -c.promise)
    waiting = [c for c in near if c.promise > pool[c.placed].log_weight + RULE.second_look_gain]
    waiting = waiting[: RULE.rivals]
    for refitted in refit.fit_each(problem, hypothesis, waiting, point, least_weight(best, fit), fit.evidence):
        known = replace(pool[refitted.placed], multistart=refitted.multistart)
        better = refitted.log_weight > known.log_weight
        pool = pool | {known.placed: replace(known, fit=refitted.fit) if better else known}
    return pool, near
