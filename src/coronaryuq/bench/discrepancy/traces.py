"""Traces of effects about the unmodified model, by which the sizes of hidden effects are drawn."""

import copy
from dataclasses import replace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden.detectability import with_known_errors
from coronaryuq.discrepancy.hidden.experiment import Experiment
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings


class Traces:
    """First-order signals of effects in the fitted data of an experiment, about the unmodified model.

    noise: multiple of the plan's noise.
    """

    def __init__(self, experiment: Experiment, noise: float):
        network, conditions, plan = experiment.network, experiment.conditions, experiment.plan
        blank = plan.blank(network, conditions, generator(0, "discrepancy", "traces"))
        problem = make_problem(network, conditions, blank, Settings())
        forward, plain = problem.forward, problem.forward.predict(np.zeros(problem.count))[0]
        deviations = plan.noise_sd(forward.measured, forward.split(plain[None, :]), noise)
        sd = np.repeat(deviations, [one.value.size for one in forward.measured])
        shapes, sd = with_known_errors(problem, sd)
        self._problem = problem
        problem.y, problem.sd, origin = plain, sd, np.zeros(problem.count)
        sensitivity = problem.sensitivity(origin, problem.whitened([(origin, PLAIN)])[0], PLAIN)
        columns = np.hstack([sensitivity, (shapes / sd).T])[problem.train]
        self._project = Fit(np.zeros(columns.shape[1]), np.zeros(len(columns)), columns).projection

    def norms(self, choices: list[tuple[PlacedEffect, np.ndarray]]) -> np.ndarray:
        """Return the norm (n,) of the signal of each placed effect with sizes z, in noise standard deviations.

        Zero if the model does not run with the effect. Does not depend on earlier calls.
        """
        problem, origin = copy.copy(self._problem), np.zeros(self._problem.count)
        problem.forward = replace(problem.forward, simulation=problem.forward.simulation.fork())
        rows = [(np.concatenate([origin, z]), Hypothesis((placed,))) for placed, z in choices]
        grafts = list(dict.fromkeys(placed for placed, _ in choices if placed.effect.grafted))
        changes = problem.fitted(rows, grafts)
        squares = [change @ self._project(change) if np.isfinite(change).all() else 0.0 for change in changes]
        return np.sqrt(np.maximum(squares, 0.0))
