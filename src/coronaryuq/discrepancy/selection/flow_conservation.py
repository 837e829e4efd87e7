"""Flow conservation: gains of several flow probes that together conserve flow indicate blood on another path.

Blood in another branch, for example through exchanged or wrongly connected outlets, resembles errors of two flow probes
by the same flow in opposite directions. No effect of the library describes that.
"""

from collections.abc import Sequence

import numpy as np

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem

PROBE = "flow_gain"
"""Name of the effect of a flow probe with a wrong gain."""


def redistribution(
    problem: Problem, fit: Fit, hypothesis: Hypothesis, log_priors: Sequence[float], effects: int
) -> float:
    """Return the log odds of blood on another path against gains of several probes; -inf without such gains.

    The gains g of probes of which none is upstream of another conserve flow if the change D = sum g Q of their readings
    is zero. The Bayes factor of that against free gains is the posterior density of D at zero over its prior density
    (Savage and Dickey; Dickey 1971). As one cause outside the library it has the prior of one of `effects` effects, and
    the gains have the product of theirs (log_priors: one per effect of the hypothesis).
    """
    probes = [
        (hypothesis.columns(fit.z, placed).start, placed.effect.parameters[0].spread, placed.place, prior)
        for placed, prior in zip(hypothesis, log_priors, strict=True)
        if placed.effect.name == PROBE
    ]
    probes = [probe for probe in probes if not any(_feeds(problem, probe[2], other[2]) for other in probes)]
    if len(probes) < 2:
        return -np.inf
    columns = [column for column, *_ in probes]
    gains = np.array([spread * fit.z[k] for k, spread, _, _ in probes])
    flows = np.array([_read(problem, fit, place) for _, _, place, _ in probes]) / (1.0 + gains)
    weight = flows * np.array([spread for _, spread, _, _ in probes])
    before = float(np.sqrt(weight @ weight))
    after = float(np.sqrt(weight @ fit.covariance[np.ix_(columns, columns)] @ weight))
    factor = np.log(before / after) - 0.5 * (float(gains @ flows) / after) ** 2
    return float(factor + np.log(RULE.prior_named / effects) - sum(prior for *_, prior in probes))


def _feeds(problem: Problem, place: str, other: str) -> bool:
    anatomy = problem.forward.anatomy
    above, below = anatomy.vessel_at(place), anatomy.vessel_at(other)
    if above is not None and above == below:
        return place == anatomy.inlet(above) != other
    return above is not None and above != below and below in anatomy.subtree(above)


def _read(problem: Problem, fit: Fit, place: str) -> float:
    """Return the predicted mean reading of a flow probe at the fit."""
    series = problem.forward.measured
    own = [i for i, s in enumerate(series) if (s.quantity, s.location) == ("flow", place)]
    rows = np.isin(problem.owner[problem.train], own)
    read = problem.y[problem.train] - fit.residual * problem.sd[problem.train]
    return float(read[rows].mean())
