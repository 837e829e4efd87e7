"""Flow gains whose changes cancel: probes err apart from each other, blood that goes elsewhere is missed somewhere.

Blood that leaves one branch for another, through outlets that were swapped or wired wrongly, reads like gains of two
probes off in opposite directions by the same flow. No effect of the library says so, thus it is outside.
"""

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.candidates import PRIOR_NAMED

PROBE = "flow_gain"


def redistribution(problem: Problem, fit: Fit, hypothesis: Hypothesis, priors: list[float], effects: int) -> float:
    """Log odds that blood goes elsewhere than modelled against gains of several probes; -inf without such gains.

    The gains g of probes of which none lies upstream of another are conserved flow where the change D = sum g Q of what
    they read is nought. The Bayes factor of that against free gains is the density of D at nought after the data over
    that before (Savage and Dickey; Dickey 1971). As one cause that the library lacks, it has the prior of one of
    `effects` effects, and the gains the product of theirs (priors: their logarithms, one for each of `hypothesis`).
    """
    probes = [
        (hypothesis.columns(fit.z, placed).start, placed.effect.parameters[0].spread, placed.place, prior)
        for placed, prior in zip(hypothesis, priors, strict=True)
        if placed.effect.name == PROBE
    ]
    probes = [one for one in probes if not any(_feeds(problem, one[2], other[2]) for other in probes)]
    if len(probes) < 2:
        return -np.inf
    columns = [one[0] for one in probes]
    gains = np.array([spread * fit.z[k] for k, spread, _, _ in probes])
    flows = np.array([_read(problem, fit, place) for _, _, place, _ in probes]) / (1.0 + gains)
    weight = flows * np.array([spread for _, spread, _, _ in probes])
    before = float(np.sqrt(weight @ weight))
    after = float(np.sqrt(weight @ fit.covariance[np.ix_(columns, columns)] @ weight))
    factor = np.log(before / after) - 0.5 * (float(gains @ flows) / after) ** 2
    return float(factor + np.log(PRIOR_NAMED / effects) - sum(prior for *_, prior in probes))


def _feeds(problem: Problem, place: str, other: str) -> bool:
    anatomy = problem.forward.anatomy
    above, below = anatomy.vessel_at(place), anatomy.vessel_at(other)
    if above is not None and above == below:
        return place == anatomy.inlet(above) != other
    return above is not None and above != below and below in anatomy.below(above)


def _read(problem: Problem, fit: Fit, place: str) -> float:
    """Mean flow that the fit predicts a probe to read."""
    series = problem.forward.measured
    mine = [i for i, s in enumerate(series) if (s.quantity, s.location) == ("flow", place)]
    rows = np.isin(problem.owner[problem.train], mine)
    read = problem.y[problem.train] - fit.residual * problem.sd[problem.train]
    return float(read[rows].mean())
