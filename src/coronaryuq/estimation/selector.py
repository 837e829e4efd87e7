"""Picks a control variate within each training set, by leave-one-out residuals and cost, never by the runs held out."""

import numpy as np

from coronaryuq.estimation.control_variates import METHODS, Fitted, Seen

# A direction across inputs adds parameters: it is tried where there are runs to fit it and something left to explain.
DIRECTION_RUNS, DIRECTION_SHARE = 80, 1e-3


def choose(seen: Seen, y: np.ndarray, simple: bool = False) -> Fitted:
    """Fit every candidate on the training runs and return the one that misses least; ties go to the simpler.

    All candidates cost the same per prediction against a 0D or 3D run, so least variance per cost is least variance.
    A more complicated method must beat the simpler ones by 2 % of their mean square to be taken.
    `simple` leaves the Gaussian processes out.
    """
    names = ["constant", "linear 0D", "linear 0D outputs", "linear theta", "quadratic 0D outputs"]
    few = {"linear 0D": 4, "linear 0D outputs": seen.outputs.shape[1] + 3, "linear theta": seen.log_theta.shape[1] + 3}
    few["quadratic 0D outputs"] = 3 * METHODS_QUADRATIC
    candidates = [METHODS[name](seen, y) for name in names if len(y) > few.get(name, 0)]
    if np.ptp(y) == 0:
        return candidates[0]
    if not simple:
        candidates.append(METHODS["process theta and 0D"](seen, y))
        best = min(candidate.missed for candidate in candidates)
        if len(y) >= DIRECTION_RUNS and best > DIRECTION_SHARE * y.var():
            candidates.append(METHODS["process with direction"](seen, y))
    taken = candidates[0]
    for candidate in candidates[1:]:
        if candidate.missed < 0.98 * taken.missed:
            taken = candidate
    return taken


METHODS_QUADRATIC = 20
