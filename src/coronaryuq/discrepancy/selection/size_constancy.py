"""Whether a named effect has the same size under all conditions: what drifts, opens or shuts is not what it is called.

A vessel whose resistance drifts looks like a narrowing that differs from one condition to the next. No effect of the
library does that: each acts with one size, and its formula says what that means under each condition.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem

FLAT = 1e3
"""Standard deviations of its prior that a common size may be off by here."""
KNOWN = np.sqrt(0.5)
"""Standard deviation, in units of the prior's, above which a condition does not tell its size: its own data take away
less than half of the prior's variance. Without any of its own it is above 1, whatever the other conditions tell."""


@dataclass(frozen=True)
class Constancy:
    """One named effect. log_odds: of sizes that differ between conditions, by the spread of the prior, over one size.

    sizes: the first size z under every condition fitted as a whole (under all, where that is one), mean and standard
    deviation in units of the prior's.
    """

    placed: PlacedEffect
    log_odds: float
    sizes: dict[str, tuple[float, float]]

    @property
    def known(self) -> dict[str, tuple[float, float]]:
        """The sizes under conditions whose own data tell of them; of two at least, as there is no difference of one."""
        second = sorted(sd for _, sd in self.sizes.values())[:2][-1]
        return {name: size for name, size in self.sizes.items() if size[1] <= max(KNOWN, second)}


def constancy(problem: Problem, fit: Fit, hypothesis: Hypothesis) -> list[Constancy]:
    """That of each effect in turn, in the linear model about the fit.

    Conditions are runs of their own, so the rows of a condition depend on that condition's size alone: sensitivities to
    it are those to the common size, nought in all other rows. The odds are a Bayes factor with equal priors, of what
    tells the conditions apart alone, and common sizes may be any: one far out in its prior is no sign that it differs.
    """
    conditions = problem.condition[problem.train]
    names = [str(name) for name in dict.fromkeys(conditions)]
    whole = [name for name in names if problem.train[problem.condition == name].all()]
    contrasts = null_space(np.ones((1, len(names))))
    found, free = [], _free(fit, hypothesis)
    for placed in hypothesis:
        columns, count = hypothesis.columns(fit.z, placed), len(placed.effect.parameters)
        own = fit.jacobian[:, columns]
        apart = np.hstack([own * (conditions == name)[:, None] for name in names])
        differing = apart @ np.kron(contrasts, np.eye(count))
        precision = np.eye(differing.shape[1]) + differing.T @ free.project(differing)
        along = differing.T @ free.score
        log_odds = 0.5 * along @ np.linalg.solve(precision, along) - 0.5 * np.linalg.slogdet(precision)[1]
        sizes = _sizes(fit, apart, columns.start, count, names)
        told = whole if len(whole) > 1 else names
        found.append(Constancy(placed, float(log_odds), {name: sizes[name] for name in told}))
    return found


def _free(fit: Fit, hypothesis: Hypothesis) -> Fit:
    """The same with a prior of the sizes so wide that it says nothing."""
    wide = np.ones(len(fit.z))
    hypothesis.all_sizes(wide)[:] = FLAT
    return Fit(fit.z / wide, fit.residual, fit.jacobian * wide)


def _sizes(fit: Fit, apart: np.ndarray, column: int, count: int, names: list[str]) -> dict[str, tuple[float, float]]:
    """First size under each condition, the common one plus its own, with everything else free."""
    sensitivities = np.hstack([fit.jacobian, apart])
    covariance = np.linalg.inv(np.eye(sensitivities.shape[1]) + sensitivities.T @ sensitivities)
    mean = covariance @ (sensitivities.T @ (fit.residual + fit.jacobian @ fit.z))
    found = {}
    for number, name in enumerate(names):
        pick = np.zeros(len(mean))
        pick[[column, len(fit.z) + number * count]] = 1.0
        found[name] = float(pick @ mean), float(np.sqrt(pick @ covariance @ pick))
    return found
