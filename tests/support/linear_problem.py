"""A problem whose model is linear in its nuisance parameters, for tests of the search without any 0D run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.forward.simulation import Simulation
from coronaryuq.discrepancy.inference.flexible import Flexible
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter

TREE = left_coronary()
ANATOMY = Anatomy(TREE)
SIZE = Parameter("size", "1", "normal", 0.0, 1.0, "")
Response = np.ndarray | Callable[[float], np.ndarray]
"""What an effect adds to predictions (N,): times its size z, or as a function of that."""


def made_up(name: str, size: Parameter = SIZE, **attributes) -> Effect:
    """An effect with one size; attributes: class attributes that differ from those of any effect."""
    return type("MadeUp", (Effect,), {"name": name, "parameters": (size,), **attributes})()


def here(name: str, **attributes) -> PlacedEffect:
    return PlacedEffect(made_up(name, **attributes), "here")


@dataclass
class LinearForward(Forward):
    """Predictions `design` (N, p) times the nuisance parameters, plus the response of each effect."""

    design: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    responses: dict[PlacedEffect, Response] = field(default_factory=dict)

    def predict_rows(self, rows, conditions=None, grafts=()):
        return np.array([self._predicted(z, hypothesis) for z, hypothesis in rows])

    def _predicted(self, z: np.ndarray, hypothesis: Hypothesis) -> np.ndarray:
        predicted = self.design @ hypothesis.nuisances(z)
        for placed in hypothesis:
            (size,), response = hypothesis.sizes(z, placed), self.responses[placed]
            predicted = predicted + (response(size) if callable(response) else response * size)
        return predicted

    def columns(self, hypothesis: Hypothesis) -> np.ndarray:
        """Sensitivities (N, p) where all effects are linear in their size."""
        return np.column_stack([self.design, *(self.responses[placed] for placed in hypothesis)])


class LinearProblem(Problem):
    """A problem with exact fits, no other starts and no time-step error; for linear responses."""

    def sensitivity(self, z, residual, hypothesis):
        return self.forward.columns(hypothesis)

    def calibrate_each(self, wanted):
        return [self._exact(hypothesis) for hypothesis, _ in wanted]

    def _exact(self, hypothesis: Hypothesis) -> Fit:
        g, y = self.forward.columns(hypothesis)[self.train], (self.y - self.change)[self.train]
        return fit_of(g, y, self.flexible)

    def corrected(self, hypothesis, fit):
        return self, fit

    def missed(self, change):
        return float(np.linalg.norm(change - self.change))

    def multistart_each(self, hypotheses):
        return [None] * len(hypotheses)


def fit_of(g: np.ndarray, y: np.ndarray, flexible: Flexible | None = None) -> Fit:
    """The exact fit of whitened data y (N,) by a linear model with sensitivities g (N, p)."""
    z = np.linalg.solve(np.eye(g.shape[1]) + g.T @ g, g.T @ y)
    return Fit(z, y - g @ z, g, flexible=flexible)


def linear_problem(
    design: np.ndarray,
    responses: dict[PlacedEffect, Response],
    y: np.ndarray,
    conditions: Sequence[str] | None = None,
    held_out: Sequence[str] = (),
    kind: type[Problem] = LinearProblem,
    **settings,
) -> Problem:
    """A problem with data y (N,) of unit noise; conditions: of each row, in blocks; those held out enter no fit."""
    owner = np.array(["rest"] * len(y) if conditions is None else conditions)
    names = list(dict.fromkeys(owner))
    measured = []
    for name in names:
        values = y[owner == name]
        time = np.arange(values.size) / values.size
        measured.append(Measured(name, "flow", "AORTA:lad", "waveform", time, 1.0, values, np.ones(values.size)))
    known = {name: Condition(name, held_out=name in held_out) for name in names}
    nuisances = [Nuisance(f"nuisance {number}", 1.0) for number in range(design.shape[1])]
    simulation = Simulation(TREE, known, ANATOMY, 300)
    forward = LinearForward(simulation, measured, nuisances, 1.0, design=design, responses=responses)
    return kind(forward, Settings(model_floor=0.0, **settings), ~np.isin(owner, held_out))


def plain_fit(problem: Problem) -> Fit:
    return problem.calibrate(PLAIN)
