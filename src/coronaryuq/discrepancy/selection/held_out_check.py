"""Held-out check: remove those of several effects that add nothing to data that entered no fit."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.data.conditions import held_out_names
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.cross_validation import Folds, Gap, gap, linearise, predicts_better
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Rounds, replaced, round_of
from coronaryuq.discrepancy.selection.refit import exact


def held_out_check(
    problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: Rounds, unexplained: bool, folds: Folds, seed: int
) -> tuple[Hypothesis, Fit, Rounds]:
    """Remove those of several effects that held-out data do not confirm, the one that adds least first.

    The increase of the log evidence of the fitted data and of the log predictive density of the others by an effect is
    its log evidence from all data, which has to suffice. If no condition is held out, each is held out in turn, and
    this sum would count the data twice. If a misfit remains (`unexplained`), held-out data must also not be predicted
    better without the effect, whose evidence may then come from that misfit. `abstention.judge` applies the same tests
    to all effects together.
    """
    has_held_out = bool(held_out_names(problem.forward.conditions))
    while len(hypothesis) > 1:
        present = gap(problem, linearise(problem, fit.z, hypothesis), folds, seed)
        others = [hypothesis.without(placed) for placed in hypothesis]
        fits = [exact(problem, fewer) for fewer in others]
        odds = np.full(len(hypothesis), np.inf)
        for number, (placed, fewer, without) in enumerate(zip(hypothesis, others, fits, strict=True)):
            entry = round_of(rounds, placed)
            without_it = None if without is None else _gap(problem, without, fewer, folds, seed)
            evidence_gain = np.inf if without is None else fit.evidence - without.evidence
            held_out_gain = np.inf if without_it is None else present.total_lpd - without_it.total_lpd
            total = evidence_gain + entry.class_log_prior + held_out_gain
            outweighed = has_held_out and total < problem.settings.min_log_odds
            if outweighed or (unexplained and without_it is not None and predicts_better(without_it, present)):
                odds[number] = total
            checked = replace(entry, evidence_gain=evidence_gain, held_out_gain=held_out_gain)
            rounds = replaced(rounds, entry, checked)
        least = int(np.argmin(odds))
        remaining = fits[least]
        if np.isinf(odds[least]) or remaining is None:
            return hypothesis, fit, rounds
        entry = round_of(rounds, hypothesis.effects[least])
        rounds = replaced(rounds, entry, replace(entry, accepted=None, refuted=entry.accepted))
        hypothesis, fit = others[least], remaining
        if len(hypothesis) == 1:
            entry = round_of(rounds, hypothesis.effects[0])
            rounds = replaced(rounds, entry, replace(entry, evidence_gain=np.inf, held_out_gain=None))
    return hypothesis, fit, rounds


def _gap(problem: Problem, fit: Fit, hypothesis: Hypothesis, folds: Folds, seed: int) -> Gap | None:
    """Return None if the model does not run under the held-out conditions."""
    try:
        return gap(problem, linearise(problem, fit.z, hypothesis), folds, seed)
    except FloatingPointError:
        return None
