"""A linear problem for tests of the search: nuisance parameters and effects that act along a column each."""

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import DISTORTED, Problem
from coronaryuq.zerod.effects.base import Effect, Parameter

SIZE = Parameter("size", "1", "normal", 0.0, 1.0, "")


def made_up(name: str, size: Parameter = SIZE, **other) -> Effect:
    """An effect with one size; other: class attributes that differ from those of any effect."""
    return type("MadeUp", (Effect,), {"name": name, "parameters": (size,), **other})()


def here(name: str) -> PlacedEffect:
    return PlacedEffect(made_up(name), "here")


class LinearProblem:
    """Subclasses set nuisance (N, p), along: effect → (N,), y (N,) and settings."""

    fit_candidates, fit_roughly = Problem.fit_candidates, Problem.fit_roughly
    change = 0.0
    """What the time steps are known to put wrong: nothing, unless a subclass says so."""

    @property
    def count(self):
        return self.nuisance.shape[1]

    def corrected(self, acting, fit):
        return self, fit

    def corrected_each(self, fits):
        return [self.corrected(acting, fit) for acting, fit in fits]

    def missed(self, change):
        return float(np.linalg.norm(change - self.change))

    def distorted(self, fit):
        return bool(np.abs(fit.z[: self.count]).max(initial=0.0) > DISTORTED)

    def from_the_mean(self, acting):
        return None

    def linear_part(self):
        return [], np.zeros((len(self.y), 0))

    def columns(self, acting):
        return np.column_stack([self.nuisance, *(self.along[one] for one in acting)])

    def fitted(self, rows, grafts=()):
        return np.array([self.y - self.columns(acting) @ z for z, acting in rows])

    def calibrate(self, acting, start=None):
        g = self.columns(acting)
        z = np.linalg.solve(np.eye(g.shape[1]) + g.T @ g, g.T @ self.y)
        return Fit(z, self.y - g @ z, g)

    def calibrate_each(self, wanted):
        return [self.calibrate(acting, start) for acting, start in wanted]
