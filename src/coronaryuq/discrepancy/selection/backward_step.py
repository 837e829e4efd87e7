"""Backward step: check whether each earlier effect is still needed, and still the best one, given the later effects."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import locate
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection import refit
from coronaryuq.discrepancy.selection.candidates import (
    Candidate,
    Round,
    Rounds,
    class_log_weight,
    least_log_odds,
    least_weight,
    likely,
    preferred,
    replaced,
    round_of,
    updated,
)
from coronaryuq.discrepancy.selection.score_test import screen


def backward_step(
    problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: Rounds, recent: int = 1
) -> tuple[Hypothesis, Fit, Rounds]:
    """Test whether each earlier effect is still needed and still the best, given the later ones; update its class.

    Stops at the first effect that is removed or replaced. The fits of its own round did not include the later effects.
    recent: number of effects at the end that their rounds chose beside all others.
    """
    for placed in hypothesis.effects[: len(hypothesis) - recent]:
        current, others = round_of(rounds, placed), hypothesis.without(placed)
        columns = hypothesis.columns(fit.z, placed)
        present = replace(current.named, fit=_moved_last(fit, columns))
        (without,) = refit.without_each(problem, hypothesis, fit, [placed])
        if without is None:
            continue
        # Other effects may have grown since: a rival's estimate is only as accurate as on the first shortlist.
        least = least_weight(present, without)
        best, tried, _ = _weigh_again(
            problem, current, present, others, refit.drop(fit, columns), least, without=without.evidence
        )
        if class_log_weight(best, tried) - without.evidence < least_log_odds(problem, others):
            return others, without, replaced(rounds, current, replace(current, accepted=None))
        rounds = replaced(rounds, current, current.decided(best, tried, others))
        if best.placed != placed:
            return others.with_(best.placed), best.fitted, rounds
    return hypothesis, fit, rounds


def correct_time_steps(
    problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: Rounds
) -> tuple[Problem, Hypothesis, Fit, Rounds]:
    """Correct the time-step error at the fit; if it was large, compare the last effect with its rivals again.

    Not if a misfit remains that another effect may explain: a backward step follows then.
    """
    before = problem
    problem, fit = before.corrected(hypothesis, fit)
    last = hypothesis.effects[-1]
    current, others = round_of(rounds, last), hypothesis.without(last)
    # A likely candidate may be an instrument that reads what the steps do not resolve.
    read = before.unresolved and any(candidate.effect.reads_waveforms for candidate in likely(current.scored))
    alike = before.missed(problem.change) < RULE.time_step_refit and not read
    if alike or locate(problem, fit).alarm(problem.settings.alarm_level):
        return problem, hypothesis, fit, rounds
    problem, hypothesis, fit, decided = compare_again(before, problem, current, others, fit)
    return problem, hypothesis, fit, replaced(rounds, current, decided)


def compare_again(
    before: Problem, problem: Problem, current: Round, others: Hypothesis, fit: Fit
) -> tuple[Problem, Hypothesis, Fit, Round]:
    """Compare a round's candidates again, each with the time-step error corrected at its own fit.

    before: the problem without that correction; problem, fit: with that of the accepted one, whose sizes come last.
    Returns problem, hypothesis, fit and round of the candidate that is accepted now; only of the other effects if the
    odds do not suffice.
    """
    present = replace(current.named, fit=fit)
    least = present.log_weight - RULE.contender_gap
    best, tried, problems = _weigh_again(
        problem, current, present, others, refit.point_without(present), least, own_time_steps=True
    )
    plain, (without,) = before, refit.without_each(before, others.with_(present.placed), fit, [present.placed])
    if without is not None:
        plain, without = before.corrected(others, without)
    evidence = -np.inf if without is None else without.evidence
    decided = current.decided(best, tried, others)
    if without is not None and class_log_weight(best, tried) - evidence < least_log_odds(problem, others):
        return plain, others, without, replace(decided, accepted=None)
    return problems.get(best.placed, problem), others.with_(best.placed), best.fitted, decided


def _weigh_again(
    problem: Problem,
    current: Round,
    present: Candidate,
    others: Hypothesis,
    point: Fit,
    least: float,
    own_time_steps: bool = False,
    without: float = -np.inf,
) -> tuple[Candidate, list[Candidate], dict[PlacedEffect, Problem]]:
    """Return the best of a round's present candidate and of rivals that promise more than `least`, and all by weight.

    If another effect of its round has been replaced since, all its candidates are rivals, not only those that were
    likely then. point: of the present one's fit, without its sizes. own_time_steps: correct the time-step error at the
    fit of each close rival; returns these problems too. without: log evidence of the others alone.
    """
    changed = any(placed not in others for placed in current.others)
    pool = current.scored if changed else likely(current.scored)
    rivals = [replace(c, fit=None, multistart=None) for c in pool if c.placed not in (*others, present.placed)]
    rivals = [c for c in screen(problem, point, others, rivals) if c.promise > least]
    rivals.sort(key=lambda c: -c.promise)
    first = refit.fit_each(problem, others, rivals[: RULE.rivals], point, least, without)
    problems = {}
    if own_time_steps:
        close = [c for c in first if c.log_weight > least]
        corrected = [problem.corrected(others.with_(c.placed), c.fitted) for c in close]
        problems = {c.placed: own for c, (own, _) in zip(close, corrected, strict=True)}
        first = updated(first, [replace(c, fit=fit) for c, (_, fit) in zip(close, corrected, strict=True)])
    members = {member.placed for member in current.members}
    fitted = [c for c in first if c.fit is not None]
    ahead = max([present, *fitted], key=lambda c: c.log_weight)
    alike = refit.fit_class(problem, others, rivals[RULE.rivals :], point, ahead, members)
    tried = sorted([present, *fitted, *alike], key=lambda c: -c.log_weight)
    return preferred(tried), tried, problems


def _moved_last(fit: Fit, columns: slice) -> Fit:
    """Return the fit with some of its parameters moved to the end."""
    order = np.r_[0 : columns.start, columns.stop : len(fit.z), columns]
    return Fit(fit.z[order], fit.residual, fit.jacobian[:, order], flexible=fit.flexible)
