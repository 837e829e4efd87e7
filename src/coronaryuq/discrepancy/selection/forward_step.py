"""One round of naming: the best candidates fitted, looked at again about the best of them, and one accepted or none."""

from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import (
    CONTENDER,
    Candidate,
    best_of_effects,
    fit_shortlist,
    indistinguishable,
    least_weight,
    likely,
    of_class,
    posterior,
    preferred,
    shortlist,
)
from coronaryuq.discrepancy.selection.refit import (
    LIKELIEST,
    RIVALS,
    around,
    by_own_steps,
    exact,
    fit_each,
    may_be_alike,
)
from coronaryuq.discrepancy.selection.score_test import screen

SECOND_LOOKS = 3
WORTH_FITTING = 0.5
"""Log evidence by which an estimate must beat a candidate's own fit to have it fitted again."""


@dataclass
class Round:
    """One round of naming: everything on the shortlist, and what was accepted (None: nothing helped enough)."""

    shortlist: list[Candidate]
    probabilities: dict[str, float]
    accepted: Candidate | None
    members: list[Candidate] = field(default_factory=list)
    """Accepted one and those that the data cannot tell from it."""
    screened: list[Candidate] = field(default_factory=list)
    """Every candidate of the round."""
    beside: Hypothesis = PLAIN
    """Other effects in the fits of the shortlist; a candidate's own sizes stand last in them."""
    worth: float = np.inf
    """Log evidence that the accepted effect adds to all the others."""
    held_out: float | None = None
    """Log predictive density that it adds to them on held-out measurements, nats; None: it is the only one."""
    taken_back: Candidate | None = None
    """What was accepted and is not borne out by measurements kept out of the fits."""
    outside_evidence: float = -np.inf
    """Log evidence of a flexible discrepancy in place of any of them."""

    @property
    def class_log_prior(self) -> float:
        """Log prior that the accepted effect would have if it stood for all of its class."""
        return of_class(self.accepted, self.members) - self.accepted.fit.evidence

    def take_back(self) -> None:
        """The accepted effect is not borne out."""
        self.accepted, self.taken_back = None, self.accepted


def name_one(
    problem: Problem,
    fit: Fit,
    hypothesis: Hypothesis,
    features: np.ndarray,
    everything: list[Candidate],
    vantage: Fit,
) -> Round:
    """One round: fit the shortlist of scored candidates, weigh, accept the best where the odds of its class suffice."""
    chosen = shortlist(everything, problem.settings.shortlist)
    fit_shortlist(problem, fit, hypothesis, chosen, vantage)
    if hypothesis and vantage is not fit:
        chosen += [c for c in _seen_from(problem, fit, hypothesis, everything) if c not in chosen]
    chosen = [c for c in chosen if c.fit is not None]
    for _ in range(SECOND_LOOKS if chosen else 0):
        before = max(chosen, key=lambda c: c.log_weight)
        near = look_again(problem, fit, before, hypothesis, chosen, everything)
        if before is max(chosen, key=lambda c: c.log_weight):
            fit_alike(problem, before, hypothesis, chosen, near, everything)
            break
    chosen.sort(key=lambda c: -c.log_weight)
    worth_naming = _worth_naming(problem, fit, chosen)
    if not worth_naming:
        by_own_steps(problem, hypothesis, best_of_effects(chosen, LIKELIEST))
        chosen.sort(key=lambda c: -c.log_weight)
        worth_naming = _worth_naming(problem, fit, chosen)
    outside_evidence = fit.evidence + gp_discrepancy.gain(fit, features[problem.train])[0]
    probabilities = posterior(fit.evidence, chosen, outside_evidence)
    if not worth_naming:
        return Round(chosen, probabilities, None, beside=hypothesis, outside_evidence=outside_evidence)
    accepted = preferred(worth_naming)
    members = indistinguishable(accepted, chosen)
    return Round(chosen, probabilities, accepted, members, everything, hypothesis, outside_evidence=outside_evidence)


def _worth_naming(problem: Problem, fit: Fit, chosen: list[Candidate]) -> list[Candidate]:
    """Those whose class has the odds over the present model that are asked for."""
    return [c for c in chosen if of_class(c, chosen) - fit.evidence >= problem.settings.least_log_odds]


def _seen_from(problem: Problem, fit: Fit, hypothesis: Hypothesis, everything: list[Candidate]) -> list[Candidate]:
    """Candidates of the shortlist as they look from a distorted fit, with their fits from there where those are better.

    From the prior's mean, where they were looked at, what is named already hides those that explain less than
    recalibration beside it does.
    """
    here = [replace(c, fit=None) for c in everything]
    screen(problem, fit, hypothesis, here)
    known = {c.placed: c for c in everything}
    chosen = shortlist(here, problem.settings.shortlist)
    fit_shortlist(problem, fit, hypothesis, chosen, fit)
    for candidate in chosen:
        one = known[candidate.placed]
        one.z_score, one.from_the_mean = max(one.z_score, candidate.z_score), candidate.from_the_mean
        if candidate.estimate > one.estimate:
            one.estimate, one.guess = candidate.estimate, candidate.guess
        if candidate.log_weight > one.log_weight:
            one.fit = candidate.fit
    return [known[candidate.placed] for candidate in chosen]


def look_again(
    problem: Problem,
    fit: Fit,
    best: Candidate,
    hypothesis: Hypothesis,
    chosen: list[Candidate],
    everything: list[Candidate],
) -> list[Candidate]:
    """Screen all candidates in the place of the best one, about its fit; add to `chosen` those that now look as good.

    Recalibration without the right effect distorts the nuisance parameters, and about such a point a neighbour of the
    right place may look best. About the best fit so far they are nearly as they should be, if it has left them within
    their prior. fit: of the present model. Returns the candidates as they look from there, those far behind left out.
    """
    if problem.distorted(best.fit):
        return []
    about = around(best)
    known = {c.placed: c for c in everything}
    fresh = [replace(c, fit=None) for c in likely(everything)]
    screen(problem, about, hypothesis, fresh)
    near = sorted((c for c in fresh if c.promise > best.log_weight - CONTENDER), key=lambda c: -c.promise)
    waiting = [c for c in near if c.promise > known[c.placed].log_weight + WORTH_FITTING][:RIVALS]
    found = fit_each(problem, hypothesis, waiting, about, least_weight(best, fit), fit.evidence)
    for candidate, its in zip(waiting, found, strict=True):
        one = known[candidate.placed]
        one.from_the_mean = candidate.from_the_mean
        if its is not None and its.evidence + one.log_prior > one.log_weight:
            one.fit = its
            if one not in chosen:
                chosen.append(one)
    return near


def fit_alike(
    problem: Problem,
    best: Candidate,
    hypothesis: Hypothesis,
    chosen: list[Candidate],
    near: list[Candidate],
    everything: list[Candidate],
) -> None:
    """Fit all that may be of the best one's class, as they look about its fit (`near`), and add them to `chosen`.

    Many more may be than a look again fits in full: each segment of one vessel, say. Sensitivities to all but their own
    sizes stay those of the best fit, of which theirs hardly differ; one that goes ahead is fitted in full.
    """
    known = {c.placed: c for c in everything}
    waiting = [c for c in near if known[c.placed].fit is None and may_be_alike(c, best)]
    if not waiting:
        return
    found = problem.fit_roughly(around(best), hypothesis, [c.placed for c in waiting], [c.guess for c in waiting])
    for candidate, fit in zip(waiting, found, strict=True):
        if fit is not None:
            known[candidate.placed].fit = fit
            chosen.append(known[candidate.placed])
    ahead = max(chosen, key=lambda c: c.log_weight)
    if ahead is not best:
        ahead.fit = exact(problem, hypothesis.with_(ahead.placed), ahead.fit.z) or ahead.fit
