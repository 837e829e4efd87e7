"""What was hidden, where that is known: the reference of every gap. No part of the search, which knows none of it."""

import numpy as np

from coronaryuq.discrepancy.data.conditions import kept_out
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.cross_validation import Gap, folds_of, gap, linearise
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.search import recalibrate


def fit_known(problem: Problem, hypothesis: Hypothesis, sizes: np.ndarray, base: Fit) -> tuple[Problem, Fit]:
    """The better fit with what was hidden, from its true sizes z beside the prior's mean or what recalibration without
    it found (`base`): a poor one would flatter the answer. The time steps are put right about it. Raises
    FloatingPointError where the model runs from neither.
    """
    starts = [np.concatenate([start, sizes]) for start in (np.zeros(problem.count), base.z)]
    found = [fit for fit in problem.calibrate_each([(hypothesis, start) for start in starts]) if fit is not None]
    if not found:
        raise FloatingPointError("the model does not run with what was hidden")
    problem, fit = problem.corrected(hypothesis, max(found, key=lambda fit: fit.evidence))
    return problem, problem.converge(hypothesis, fit)


def known_gap(problem: Problem, hypothesis: Hypothesis, sizes: np.ndarray, seed: int) -> Gap:
    """Held-out gap with what was hidden."""
    plain, base = recalibrate(problem)
    plain, fit = fit_known(plain, hypothesis, sizes, base)
    parts = folds_of(plain, kept_out(plain.forward.conditions))
    return gap(plain, linearise(plain, fit.z, hypothesis), parts, seed)
