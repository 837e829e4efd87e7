"""What each of several named effects is worth, also to measurements that no fit had seen; those that are not go."""

import numpy as np

from coronaryuq.discrepancy.data.conditions import kept_out
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.cross_validation import Gap, better, gap, linearise
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.forward_step import Round
from coronaryuq.discrepancy.selection.refit import exact

Folds = list[tuple[np.ndarray, np.ndarray]]


def borne_out(
    problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: list[Round], still: bool, parts: Folds, seed: int
) -> tuple[Hypothesis, Fit]:
    """Take back those of several effects that held-out measurements do not bear out, the one worth least first.

    What an effect adds to the log evidence of the fitted measurements, and to the log predictive density of the others,
    is its log evidence from all of them, which has to suffice; where no condition is kept out, each in turn is, and
    that would count them twice. Where something remains (`still`), they must not be predicted better without it
    either: what is fitted may then stand for what remains, and its evidence for nothing. The same is asked of all
    together by `abstention.judge`. Rounds of several effects get both numbers (`worth`, `held_out`).
    """
    tested = kept_out(problem.forward.conditions)
    while len(hypothesis) > 1:
        entries = [next(r for r in rounds if r.accepted is not None and r.accepted.placed == p) for p in hypothesis]
        present = gap(problem, linearise(problem, fit.z, hypothesis), parts, seed)
        others = [hypothesis.without(placed) for placed in hypothesis]
        fits = [exact(problem, those) for those in others]
        odds = np.full(len(hypothesis), np.inf)
        for number, (entry, those, without) in enumerate(zip(entries, others, fits, strict=True)):
            its = None if without is None else _gap(problem, without, those, parts, seed)
            entry.worth = np.inf if without is None else fit.evidence - without.evidence
            entry.held_out = np.inf if its is None else present.total_lpd - its.total_lpd
            all_of_them = entry.worth + entry.class_log_prior + entry.held_out
            outweighed = tested and all_of_them < problem.settings.least_log_odds
            if outweighed or (still and its is not None and better(its, present)):
                odds[number] = all_of_them
        least = int(np.argmin(odds))
        if np.isinf(odds[least]):
            return hypothesis, fit
        hypothesis, fit = others[least], fits[least]
        entries.pop(least).take_back()
        if len(hypothesis) == 1:
            entries[0].worth, entries[0].held_out = np.inf, None
    return hypothesis, fit


def _gap(problem: Problem, fit: Fit, hypothesis: Hypothesis, parts: Folds, seed: int) -> Gap | None:
    """None where the model does not run under the held-out conditions."""
    try:
        return gap(problem, linearise(problem, fit.z, hypothesis), parts, seed)
    except FloatingPointError:
        return None
