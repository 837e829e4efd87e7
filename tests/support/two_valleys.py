"""A problem whose fit has two optima: sizes near 2, which explains the data, and near -2, less well."""

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.inference.problem import Problem
from support.linear_problem import here, linear_problem


def two_valleys(kind: type[Problem] = Problem) -> tuple[Problem, PlacedEffect]:
    """One nuisance parameter and one effect, which cannot be run at size zero."""

    def response(size: float) -> np.ndarray:
        failed = np.nan if size == 0.0 else 0.0
        return np.array([4.0 - size**2, -0.3 * (size - 2.0) * (size < 0.0), failed])

    placed = here("made up")
    design = np.array([[0.0], [0.0], [-0.2]])
    return linear_problem(design, {placed: response}, np.array([0.0, 0.0, 0.0]), kind=kind), placed
