"""Fits of candidates beside other effects: roughly first, in full where they compete, with time steps of their own."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import LARGEST_CLASS_ODDS, Candidate, lost, refit

RIVALS = 5
"""Candidates that a look back, or a second look about a better point, fits in full."""
LIKELIEST = 3
"""Effects whose best candidates are fitted, or fitted again, where no test sees anything or none is worth naming."""
ALIKE = LARGEST_CLASS_ODDS + 2.0
"""Log odds, or log Bayes factor, by which an estimate about the best fit may fall behind it and be of its class."""


def by_own_steps(problem: Problem, hypothesis: Hypothesis, candidates: list[Candidate]) -> None:
    """Fit candidates beside other effects again, each with the time steps put right about itself."""
    found = problem.corrected_each([(hypothesis.with_(c.placed), c.fit) for c in candidates])
    for candidate, (_, fit) in zip(candidates, found, strict=True):
        candidate.fit = fit


def may_be_alike(candidate: Candidate, best: Candidate) -> bool:
    """Whether a candidate may be of the class of the best one, as it looks about its fit."""
    return min(best.log_weight - candidate.promise, best.fit.evidence - candidate.estimate) < ALIKE


def around(best: Candidate) -> Fit:
    """The point of a candidate's fit without its own sizes."""
    return less(best.fit, Hypothesis((best.placed,)).columns(best.fit.z, best.placed))


def less(fit: Fit, columns: slice) -> Fit:
    """The point of a fit without these of its parameters."""
    return Fit(np.delete(fit.z, columns), fit.residual, np.delete(fit.jacobian, columns, axis=1))


def exact(problem: Problem, hypothesis: Hypothesis, start: np.ndarray | None = None) -> Fit | None:
    """A fit in full, None where the model does not run at its start."""
    return problem.calibrate_each([(hypothesis, start)])[0]


def fit_each(
    problem: Problem,
    hypothesis: Hypothesis,
    candidates: list[Candidate],
    about: Fit,
    least: float = -np.inf,
    without: float = -np.inf,
) -> list[Fit | None]:
    """Fits of candidates beside other effects, from a point and their own guesses: with the sensitivities there, and
    then, where they weigh more than `least`, in full; without: log evidence of the other effects alone, by which those
    that went astray are known and fitted from other points."""
    found = problem.fit_roughly(about, hypothesis, [c.placed for c in candidates], [c.guess for c in candidates])
    weights = [-np.inf if fit is None else fit.evidence + c.log_prior for c, fit in zip(candidates, found, strict=True)]
    close = [i for i, weight in enumerate(weights) if weight > least]
    fully = problem.calibrate_each([(hypothesis.with_(candidates[i].placed), found[i].z) for i in close])
    for i, fit in zip(close, fully, strict=True):
        found[i] = fit or found[i]
    tried = [replace(candidate, fit=fit) for candidate, fit in zip(candidates, found, strict=True)]
    refit(problem, hypothesis, lost(tried, least, without))
    for candidate, one in zip(candidates, tried, strict=True):
        candidate.from_the_mean = one.from_the_mean
    return [candidate.fit for candidate in tried]
