"""Held-out gap of the true effects, the reference for every other gap; the search never uses it."""

import numpy as np

from coronaryuq.discrepancy.data.conditions import held_out_names
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.cross_validation import Gap, folds_of, gap, linearise
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.search import recalibrate


def fit_known(problem: Problem, hypothesis: Hypothesis, sizes: np.ndarray, base: Fit) -> tuple[Problem, Fit]:
    """Fit the hidden effects from their true sizes, with the time-step error corrected.

    Of two starts of the nuisance parameters, their prior mean and the recalibration `base`, the better fit is returned:
    a poor reference would flatter the search.

    Raises
    ------
    FloatingPointError
        If the model runs from neither start.
    """
    starts = [np.concatenate([start, sizes]) for start in (np.zeros(problem.count), base.z)]
    fits = [fit for fit in problem.calibrate_each([(hypothesis, start) for start in starts]) if fit is not None]
    if not fits:
        raise FloatingPointError("the model does not run with the hidden effects")
    problem, fit = problem.corrected(hypothesis, max(fits, key=lambda fit: fit.evidence))
    return problem, problem.converge(hypothesis, fit)


def known_gap(problem: Problem, hypothesis: Hypothesis, sizes: np.ndarray, seed: int) -> Gap:
    """Return the held-out gap of the model with the hidden effects."""
    plain, base = recalibrate(problem)
    plain, fit = fit_known(plain, hypothesis, sizes, base)
    parts = folds_of(plain, held_out_names(plain.forward.conditions))
    return gap(plain, linearise(plain, fit.z, hypothesis), parts, seed)
