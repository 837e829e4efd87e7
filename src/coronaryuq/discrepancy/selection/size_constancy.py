"""Size constancy: whether an effect has the same size under all conditions.

A vessel whose resistance drifts resembles a narrowing that differs between conditions. No effect of the library drifts:
each has one size, and its formula gives its action under each condition.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem

LEAST_FACTOR = 2.0
"""Typical factor between the sizes of one effect under two conditions, if they differ; more where the prior is wide."""
FLAT = 1e3
"""Factor on the prior standard deviation of a common size: any size may be common to all conditions."""


@dataclass(frozen=True)
class Constancy:
    """Evidence that the size of an effect differs between conditions.

    log_odds: of sizes that differ, by `LEAST_FACTOR` or the spread of the prior, against one size. sizes: condition →
    mean and standard deviation of the first size z, in the model that is linear about z = `about`.
    """

    placed: PlacedEffect
    log_odds: float
    sizes: dict[str, tuple[float, float]]
    about: float = 0.0

    @property
    def known(self) -> dict[str, tuple[float, float]]:
        """Sizes under conditions whose own data inform them; at least two, because a single one cannot differ.

        Without data of its own a condition's standard deviation is above 1, whatever the others are.
        """
        second = sorted(sd for _, sd in self.sizes.values())[:2][-1]
        return {name: size for name, size in self.sizes.items() if size[1] <= max(RULE.informed_size, second)}


def constancy(problem: Problem, model: Linear, hypothesis: Hypothesis) -> list[Constancy]:
    """Return the constancy of each effect in turn by all data, held-out ones included, in the model about a fit.

    Conditions are separate runs, so the rows of a condition depend on that condition's size alone: sensitivities to it
    are those to the common size, and zero in all other rows. The odds are a Bayes factor with equal priors of the
    contrasts between conditions; the common size is unrestricted, because a common size far out in its prior is not a
    difference. The size of an effect that acts under one condition alone cannot differ.
    """
    names = list(problem.forward.conditions)
    contrasts = null_space(np.ones((1, len(names))))
    constancies, free = [], _free(model, hypothesis)
    common = problem.all_data.evidence(free.at_zero, free.jacobian).right
    for placed in hypothesis:
        columns, count = hypothesis.columns(model.z, placed), len(placed.effect.parameters)
        own = model.jacobian[:, columns]
        by_condition = np.hstack([own * (problem.condition == name)[:, None] for name in names])
        differing = free.extended(by_condition @ np.kron(contrasts, np.diag(_spreads(placed))))
        acting = [name for name in names if own[problem.condition == name].any()]
        separate = problem.all_data.evidence(differing.at_zero, differing.jacobian).right
        log_odds = separate - common if len(acting) > 1 else -np.inf
        sizes = _sizes(model, by_condition, columns.start, count, names)
        constancies.append(Constancy(placed, float(log_odds), sizes, float(model.z[columns.start])))
    return constancies


def _spreads(placed: PlacedEffect) -> list[float]:
    """Return the prior standard deviations, in z, of the differences of an effect's sizes between conditions."""
    return [max(1.0, (p.kind == "lognormal") * np.log(LEAST_FACTOR) / p.spread) for p in placed.effect.parameters]


def _free(model: Linear, hypothesis: Hypothesis) -> Linear:
    """Return the model with an uninformative prior of the sizes."""
    wide = np.ones(len(model.z))
    hypothesis.all_sizes(wide)[:] = FLAT
    return Linear(model.z / wide, model.residual, model.jacobian * wide)


def _sizes(
    model: Linear, by_condition: np.ndarray, column: int, count: int, names: list[str]
) -> dict[str, tuple[float, float]]:
    """Return the first size under each condition, the common one plus a difference, with all other parameters free."""
    wide = model.extended(by_condition)
    covariance = np.linalg.inv(np.eye(len(wide.z)) + wide.jacobian.T @ wide.jacobian)
    mean = covariance @ (wide.jacobian.T @ wide.at_zero)
    sizes = {}
    for number, name in enumerate(names):
        pick = np.zeros(len(mean))
        pick[[column, len(model.z) + number * count]] = 1.0
        sizes[name] = float(pick @ mean), float(np.sqrt(pick @ covariance @ pick))
    return sizes
