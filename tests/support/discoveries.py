"""Answers of a search, made from what they say."""

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Gap
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import Located
from coronaryuq.discrepancy.selection.abstention import Gaps, Verdict
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.zerod.effects.base import Effect
from support.linear_problem import linear_problem

CLEAR = Verdict(
    wiring_errors=[],
    redistributed=False,
    refuted=False,
    implausible=False,
    outperformed=False,
    constancies=[],
    varying=[],
    predictive_p=0.5,
    unpredicted=False,
    gain_beside_flexible=None,
)


def gap(total_lpd: float, rows: int = 10) -> Gap:
    return Gap(1.0, (0.9, 1.1), {}, total_lpd / rows, total_lpd, np.zeros(rows))


def discovery(
    sizes: dict[Effect, float],
    evidence: float = 0.0,
    log_prior: float = 0.0,
    held_out: bool = True,
    held_out_lpd: float = 0.0,
) -> Discovery:
    """An answer that names effects at "here" with these sizes z; evidence: log evidence of their fit."""
    placed = [PlacedEffect(effect, "here") for effect in sizes]
    problem = linear_problem(np.zeros((2, 0)), {}, np.zeros(2), ["rest", "pacing"], ["pacing"] if held_out else [])
    z = np.array(list(sizes.values()), dtype=float)
    fit = Fit(z, np.array([np.sqrt(max(-2.0 * evidence - z @ z, 0.0))]), np.zeros((1, len(z))))
    candidates = [Candidate(one, log_prior, fit=fit) for one in placed]
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
        rounds=tuple(Round([c], {}, c, [c]) for c in candidates),
        gaps=Gaps(gap(0.0), gap(held_out_lpd), gap(0.0), gap(0.0)),
        verdict=CLEAR,
        folds=[],
        measured=problem.forward.measured,
        scatter={},
    )
