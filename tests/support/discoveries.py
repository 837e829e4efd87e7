"""Answers of a search, made from what they say."""

import numpy as np

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Gap, Gaps
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import Located
from coronaryuq.discrepancy.selection.answer import ALONE, NAMES, NOTHING, OTHER, Answer, beyond
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.zerod.effects.base import Effect
from support.linear_problem import linear_problem


def gap(total_lpd: float, rows: int = 10) -> Gap:
    return Gap(1.0, (0.9, 1.1), {}, total_lpd / rows, total_lpd, np.zeros(rows))


def discovery(
    sizes: dict[Effect, float],
    evidence: float = 0.0,
    log_prior: float = 0.0,
    probability: float = 0.9,
) -> Discovery:
    """An answer that names effects at "here" with these sizes z; evidence: log evidence of their fit."""
    placed = [PlacedEffect(effect, "here") for effect in sizes]
    problem = linear_problem(np.zeros((2, 0)), {}, np.zeros(2), ["rest", "pacing"], ["pacing"])
    z = np.array(list(sizes.values()), dtype=float)
    fit = Fit(z, np.array([np.sqrt(max(-2.0 * evidence - z @ z, 0.0))]), np.zeros((1, len(z))))
    candidates = [Candidate(one, log_prior, fit=fit, share=1.0) for one in placed]
    located = Located(1e-9, {}, [], [])
    return Discovery(
        base_problem=problem,
        base=fit,
        problem=problem,
        hypothesis=Hypothesis(tuple(placed)),
        fit=fit,
        located=located,
        alarm=True,
        remaining=located,
        rounds=tuple(Round([c], c, [c]) for c in candidates),
        gaps=Gaps(gap(0.0), gap(0.0), gap(0.0), gap(0.0)),
        answer=Answer(
            probabilities={NAMES: probability, NOTHING: 0.0, OTHER: 1.0 - probability},
            forms={ALONE: 1.0 - probability},
            shown={("", ""): 1.0},
            device="",
            picked_up=[],
            log_evidence=evidence + log_prior,
            support=0.0,
            wiring_errors=[],
            implausible=beyond(fit, Hypothesis(tuple(placed)), RULE.implausible),
            constancies=[],
        ),
        held_out_p=0.5,
        folds=[],
        measured=problem.forward.measured,
    )
