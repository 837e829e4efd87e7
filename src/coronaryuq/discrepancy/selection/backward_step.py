"""Earlier effects asked again beside later ones, and the last with the time steps put right about it."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import locate
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import (
    CONTENDER,
    Candidate,
    indistinguishable,
    least_weight,
    likely,
    of_class,
    posterior,
    preferred,
)
from coronaryuq.discrepancy.selection.forward_step import Round
from coronaryuq.discrepancy.selection.refit import RIVALS, around, exact, fit_each, less, may_be_alike
from coronaryuq.discrepancy.selection.score_test import screen

RINGS = 3.0
"""Noise standard deviations by which time steps were put right from which another candidate may do better with it."""


def look_back(problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: list[Round]) -> tuple[Hypothesis, Fit]:
    """Ask again whether each earlier effect is needed, whether another candidate would now do better, and which ones
    the data cannot tell from it now: its round's fits knew nothing of the later effects."""
    accepted = {r.accepted.placed: r for r in rounds if r.accepted is not None}
    for placed in hypothesis.effects[:-1]:
        current = accepted[placed]
        others = hypothesis.without(placed)
        columns = hypothesis.columns(fit.z, placed)
        about = less(fit, columns)
        present = replace(current.accepted, fit=_last(fit, columns))
        without = exact(problem, others)
        if without is None:
            continue
        # Other effects may have grown by then: what a rival promises is as rough as on the first shortlist.
        least = least_weight(present, without)
        best, tried = _weighed(problem, current, present, others, about, least, without=without.evidence)
        if of_class(best, tried) - without.evidence < problem.settings.least_log_odds:
            current.accepted = None
            return others, without
        _decide(current, best, tried, without.evidence, others)
        if best is not present:
            return others.with_(best.placed), best.fit
    return hypothesis, fit


def correct(problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: list[Round]) -> tuple[Problem, Hypothesis, Fit]:
    """Put the time steps right about the named effects; where that was much, about what competed with the last, too,
    unless something is left that another effect may explain: a look back comes after that."""
    before = problem
    problem, fit = before.corrected(hypothesis, fit)
    if problem.missed(before.change) < RINGS or locate(problem, fit).alarm(problem.settings.alarm_level):
        return problem, hypothesis, fit
    last = hypothesis.effects[-1]
    current = next(r for r in rounds if r.accepted is not None and r.accepted.placed == last)
    return _compete_again(before, problem, current, hypothesis.without(last), fit)


def _compete_again(
    before: Problem, problem: Problem, current: Round, others: Hypothesis, fit: Fit
) -> tuple[Problem, Hypothesis, Fit]:
    """Weigh a round's candidates anew beside other effects, each with the time steps put right about itself.

    before: the problem without that; problem, fit: with that about the accepted one, whose sizes stand last. Returns
    the problem, effects and fit of what is accepted now: nothing beside the others where the odds do not suffice.
    """
    present = replace(current.accepted, fit=fit)
    problems = {present.placed: problem}
    least = present.log_weight - CONTENDER
    best, tried = _weighed(problem, current, present, others, around(present), least, problems)
    plain, without = before, exact(before, others)
    if without is not None:
        plain, without = before.corrected(others, without)
    _decide(current, best, tried, -np.inf if without is None else without.evidence, others)
    if without is not None and of_class(best, tried) - without.evidence < problem.settings.least_log_odds:
        current.accepted = None
        return plain, others, without
    return problems.get(best.placed, problem), others.with_(best.placed), best.fit


def _weighed(
    problem: Problem,
    current: Round,
    present: Candidate,
    others: Hypothesis,
    about: Fit,
    least: float,
    problems: dict[PlacedEffect, Problem] | None = None,
    without: float = -np.inf,
) -> tuple[Candidate, list[Candidate]]:
    """The best, and all fitted by weight, of a round's present candidate and what promises more than `least`.

    Where an effect that the round knew beside it has been replaced, all its candidates are looked at anew, not only
    those that were likely then.

    about: the point of the present one's fit without its own sizes; problems: gets those that have the time steps put
    right about each of the ones that are fitted in full; None: the time steps stay as they are. without: log evidence
    of the others alone.
    """
    replaced = any(one not in others for one in current.beside)
    pool = current.screened if replaced else likely(current.screened)
    rivals = [replace(c, fit=None, from_the_mean=None) for c in pool if c.placed not in (*others, present.placed)]
    screen(problem, about, others, rivals)
    rivals = sorted((c for c in rivals if c.promise > least), key=lambda c: -c.promise)
    first = rivals[:RIVALS]
    for rival, its in zip(first, fit_each(problem, others, first, about, least, without), strict=True):
        rival.fit = its
    if problems is not None:
        close = [rival for rival in first if rival.log_weight > least]
        found = problem.corrected_each([(others.with_(rival.placed), rival.fit) for rival in close])
        for rival, (its, fit) in zip(close, found, strict=True):
            problems[rival.placed], rival.fit = its, fit
    # Of a large class, every pair of outlets perhaps, the sensitivities hardly differ from the present one's.
    members = {member.placed for member in current.members}
    ahead = max([present, *(c for c in rivals if c.fit is not None)], key=lambda c: c.log_weight)
    alike = [c for c in rivals[RIVALS:] if c.placed in members or may_be_alike(c, ahead)]
    found = problem.fit_roughly(about, others, [c.placed for c in alike], [c.guess for c in alike])
    for rival, its in zip(alike, found, strict=True):
        rival.fit = its
    tried = sorted([present, *(c for c in rivals if c.fit is not None)], key=lambda c: -c.log_weight)
    best = preferred(tried)
    if best in alike:
        best.fit = exact(problem, others.with_(best.placed), best.fit.z) or best.fit
    return best, tried


def _decide(current: Round, best: Candidate, tried: list[Candidate], without: float, others: Hypothesis) -> None:
    """Let a round have another outcome, beside other effects; without: log evidence of those alone."""
    current.probabilities = posterior(without, tried, current.outside_evidence)
    current.shortlist, current.beside = tried, others
    current.accepted, current.members = best, indistinguishable(best, tried)


def _last(fit: Fit, columns: slice) -> Fit:
    """The same fit with these of its parameters moved to the end."""
    order = np.r_[0 : columns.start, columns.stop : len(fit.z), columns]
    return Fit(fit.z[order], fit.residual, fit.jacobian[:, order])
