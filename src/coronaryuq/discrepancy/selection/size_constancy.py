"""Size constancy: whether an effect has the same size under all conditions.

A vessel whose resistance drifts resembles a narrowing that differs between conditions. No effect of the library drifts:
each has one size, and its formula gives its action under each condition.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import of_all
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem

LEAST_FACTOR = 2.0
"""Typical factor of an effect's size under one condition on the common size, if they differ; more with a wide prior."""
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
        columns, spreads = hypothesis.columns(model.z, placed), _spreads(placed)
        own = model.jacobian[:, columns]
        by_condition = np.hstack([own * (problem.condition == name)[:, None] for name in names])
        differing = free.extended(by_condition @ np.kron(contrasts, np.diag(spreads)))
        acting = [name for name in names if own[problem.condition == name].any()]
        separate = problem.all_data.evidence(differing.at_zero, differing.jacobian).right
        log_odds = separate - common if len(acting) > 1 else -np.inf
        sizes = _sizes(problem, model, by_condition * np.tile(spreads, len(names)), columns.start, spreads)
        constancies.append(Constancy(placed, float(log_odds), sizes, float(model.z[columns.start])))
    return constancies


def _spreads(placed: PlacedEffect) -> list[float]:
    """Return the prior standard deviations, in z, of what an effect's sizes have of their own under each condition."""
    return [max(1.0, (p.kind == "lognormal") * np.log(LEAST_FACTOR) / p.spread) for p in placed.effect.parameters]


def _free(model: Linear, hypothesis: Hypothesis) -> Linear:
    """Return the model with an uninformative prior of the sizes."""
    wide = np.ones(len(model.z))
    hypothesis.all_sizes(wide)[:] = FLAT
    return Linear(model.z / wide, model.residual, model.jacobian * wide)


def _sizes(
    problem: Problem, model: Linear, own: np.ndarray, column: int, spreads: list[float]
) -> dict[str, tuple[float, float]]:
    """Return the first size under each condition, the common one plus its own part, with all other parameters free.

    own: sensitivities (N, conditions x sizes) to one prior standard deviation of the conditions' own parts. The model
    may have an error of its own, as in the sizes that are common to all conditions.
    """
    wide = model.extended(own)
    mean, covariance = of_all(problem, wide).moments()
    sizes = {}
    for number, name in enumerate(problem.forward.conditions):
        pick = np.zeros(len(mean))
        pick[column], pick[len(model.z) + number * len(spreads)] = 1.0, spreads[0]
        sizes[name] = float(pick @ mean), float(np.sqrt(pick @ covariance @ pick))
    return sizes
