"""What a rival sees of a case, and how it answers: one protocol for all of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from coronaryuq.bench.discrepancy.trial import read_case
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import locate
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import Candidate, all_candidates
from coronaryuq.discrepancy.selection.observed_noise import (
    observe,
    uneven_noise,
    with_observed_noise,
    with_uneven_noise,
)
from coronaryuq.discrepancy.selection.refit import fit_shortlist
from coronaryuq.discrepancy.selection.score_test import screen
from coronaryuq.discrepancy.selection.search import recalibrate

MOST_NAMES = 3
"""Maximum number of effects in an answer, as in the search."""

LOOKALIKES, LEAST_ALIKE = 8, 0.8
"""Candidates that are fitted where a linear method chose one, and the least cos^2 of the angle of their responses."""
Class = tuple[PlacedEffect, ...]
Trail = tuple[tuple[tuple[Class, ...], float], ...]


@dataclass(frozen=True)
class RivalAnswer:
    """Names, something else (an alarm without a name) or nothing.

    classes: the effects named, each first in its class of indistinguishable ones; probability: of the answer, None if
    the method states none. trail: see `first_sufficient`.
    """

    classes: tuple[Class, ...] = ()
    alarmed: bool = False
    probability: float | None = None
    trail: Trail = ()


def first_sufficient(trail: Trail, level: float) -> RivalAnswer:
    """Return the first names that leave nothing significant, or something else.

    Parameters
    ----------
    trail
        Classes of effects that a method tries in turn, none for the plain model, each with the p-value of what the
        model with them leaves of the data.
    level
        Below this, the p-value is significant.
    """
    for classes, p in trail:
        if p >= level:
            return RivalAnswer(classes, bool(classes), trail=trail)
    return RivalAnswer((), alarmed=True, trail=trail)


class Rival(Protocol):
    """A method that answers what a model lacks."""

    name: str

    def answer(self, seen: "Seen") -> RivalAnswer:
        """Return the answer to a case."""
        ...


@dataclass(frozen=True, eq=False)
class Seen:
    """A case as our search sees it before it chooses, or after a choice; no truth.

    Attributes
    ----------
    problem
        Data and model, with the noise that the waveforms show, and without outliers.
    fit
        The model, recalibrated together with the effects of `hypothesis`.
    hypothesis
        Effects in the model; none at first.
    """

    problem: Problem
    fit: Fit
    hypothesis: Hypothesis = PLAIN

    @cached_property
    def point(self) -> Fit:
        """Where candidates are scored: the fit, or the prior mean if recalibration has left the prior."""
        return self.problem.linearisation_point(self.fit, self.hypothesis)

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Every further effect of the library at every place, with its score test and response to a small size."""
        return screen(self.problem, self.point, self.hypothesis, all_candidates(self.problem, self.hypothesis))

    @cached_property
    def linear(self) -> "Dictionary":
        """The linearised responses of the candidates."""
        return Dictionary(self.point, self.candidates)

    @cached_property
    def misfit(self) -> float:
        """The p-value of what the model leaves of the data: the first four tests of our search, without the effects."""
        return locate(self.problem, self.fit).p

    @property
    def criterion(self) -> float:
        """BIC = |e|^2 + |z|^2 + k log N: z the nuisance parameters, k the number of sizes, which have no prior."""
        nuisances = self.hypothesis.nuisances(self.fit.z)
        deviance = float(self.fit.residual @ self.fit.residual + nuisances @ nuisances)
        return deviance + len(self.hypothesis.parameters) * float(np.log(len(self.fit.residual)))

    def with_best(self, candidates: list[Candidate]) -> "tuple[Seen, Class] | None":
        """Fit candidates in full, each by itself together with `hypothesis`, and add the best by the criterion.

        Returns
        -------
        seen, class
            The case with it, and all that the data distinguish from it with odds of less than 20 to 1, itself first.
            None if no candidate can be fitted.
        """
        scored = {candidate.placed for candidate in candidates}
        fitted = fit_shortlist(self.problem, self.fit, self.hypothesis, candidates, self.point, scored)
        tried = [self._given(candidate) for candidate in fitted if candidate.fit is not None]
        if not tried:
            return None
        tried.sort(key=lambda seen: seen.criterion)
        close = [seen for seen in tried if seen.criterion - tried[0].criterion < 2.0 * RULE.class_odds]
        return tried[0], tuple(seen.hypothesis.effects[-1] for seen in close)

    def _given(self, fitted: Candidate) -> "Seen":
        return Seen(self.problem, fitted.fitted, self.hypothesis.with_(fitted.placed))


def look(folder: Path, threads: int = 1) -> Seen:
    """Read, recalibrate and screen a case from its three files, by the steps of our search.

    Raises
    ------
    FloatingPointError
        If the model does not run.
    """
    problem = read_case(folder, threads)
    if uneven := uneven_noise(problem):
        problem = with_uneven_noise(problem, uneven)
    problem = with_observed_noise(problem, observe(problem, PLAIN, problem.recalibrated), lambda line: None)
    return Seen(*recalibrate(problem))


class Dictionary:
    """Candidates' responses and the data, linear about a point and without what recalibration absorbs.

    With P the marginal precision of the recalibrated model (`gauss_newton`), both are multiplied by its square root, so
    that their noise is independent with unit standard deviation.

    Attributes
    ----------
    candidates
        Those that the data can show, with a possible sign.
    columns
        Their responses, of unit norm: (N, n).
    data
        Residual without recalibration: (N,).
    """

    def __init__(self, point: Fit, candidates: Iterable[Candidate]):
        self._left, values, _ = np.linalg.svd(point.jacobian, full_matrices=False)
        self._shrunk = 1.0 / np.hypot(1.0, values) - 1.0
        self.data = self.root(point.at_zero)
        self.candidates = [c for c in candidates if c.z_score > 0.0 and c.response is not None]
        self.columns = np.zeros((len(self.data), len(self.candidates)))
        for number, candidate in enumerate(self.candidates):
            assert candidate.response is not None
            column = self.root(candidate.response)
            self.columns[:, number] = column / np.linalg.norm(column)

    def root(self, vector: np.ndarray) -> np.ndarray:
        """Return the square root of P times a vector (N,)."""
        return vector + self._left @ (self._shrunk * (self._left.T @ vector))

    def lookalikes(self, number: int) -> list[Candidate]:
        """Return a candidate and those that the linear model may have mistaken for it, at most `LOOKALIKES`."""
        alike = (self.columns[:, number] @ self.columns) ** 2
        nearest = np.argsort(-alike, kind="stable")[:LOOKALIKES]
        return [self.candidates[i] for i in nearest if alike[i] >= LEAST_ALIKE]
