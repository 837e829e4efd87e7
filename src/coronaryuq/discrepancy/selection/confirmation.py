"""Confirmation of several effects by all data: those without which the model is as probable are removed."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.cross_validation import evidence_of_all
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Rounds, replaced, round_of
from coronaryuq.discrepancy.selection.refit import without_each


def confirm(problem: Problem, hypothesis: Hypothesis, fit: Fit, rounds: Rounds) -> tuple[Hypothesis, Fit, Rounds]:
    """Remove those of several effects that all data together do not confirm, the one that adds least first.

    The increase of the log evidence of all data, held-out ones included, by an effect has to suffice, as in a forward
    step.
    """
    while len(hypothesis) > 1:
        present, odds = _evidence(problem, fit, hypothesis), []
        fits = without_each(problem, hypothesis, fit, hypothesis)
        for placed, without in zip(hypothesis, fits, strict=True):
            entry, total, evidence_gain = round_of(rounds, placed), np.inf, np.inf
            if without is not None:
                total = present - _evidence(problem, without, hypothesis.without(placed))
                evidence_gain = _of_fitted(problem, fit) - _of_fitted(problem, without)
            odds.append(total + entry.class_log_prior)
            held_out_gain = total - evidence_gain if np.isfinite(total) else np.inf
            rounds = replaced(rounds, entry, replace(entry, evidence_gain=evidence_gain, held_out_gain=held_out_gain))
        least = hypothesis.effects[int(np.argmin(odds))]
        remaining, entry = fits[int(np.argmin(odds))], round_of(rounds, least)
        if min(odds) >= problem.settings.min_log_odds or remaining is None:
            return hypothesis, fit, rounds
        rounds = replaced(rounds, entry, replace(entry, accepted=None, refuted=entry.accepted))
        hypothesis, fit = hypothesis.without(least), remaining
        if len(hypothesis) == 1:
            entry = round_of(rounds, hypothesis.effects[0])
            rounds = replaced(rounds, entry, replace(entry, evidence_gain=np.inf, held_out_gain=None))
    return hypothesis, fit, rounds


def _evidence(problem: Problem, fit: Fit, hypothesis: Hypothesis) -> float:
    """Return the log evidence of all data; -inf if the model does not run under the held-out conditions."""
    try:
        return evidence_of_all(problem, fit, hypothesis).right
    except FloatingPointError:
        return -np.inf


def _of_fitted(problem: Problem, fit: Fit) -> float:
    """Return the log evidence of the fitted data, averaged over the same noises as that of all data."""
    return problem.fitted_data.evidence(fit.at_zero, fit.jacobian, fit.unreached).right
