"""Choose a control variate within each training set by leave-one-out residuals, never by the held-out runs."""

import numpy as np

from coronaryuq.estimation.surrogates.control_variates import METHODS, Fitted, Seen, with_rival

# Fewest runs for a regression on that many columns.
QUADRATIC_RUNS = 60
# A direction across inputs adds parameters: it is tried if there are runs to fit it and variance left to explain.
DIRECTION_RUNS, DIRECTION_SHARE = 80, 1e-4
# With fewer runs two processes differ so often that the reported standard error was 1.4 times the empirical one (three
# levels, 25 runs).
LOGARITHM_RUNS = 40
# Residual fraction of the variance that is good enough: less would not change any interval.
GOOD_ENOUGH = 1e-9
# A more complicated method must leave less than this fraction of a simpler one's mean square to be chosen.
BETTER = 0.98


def choose(seen: Seen, y: np.ndarray, simple: bool = False) -> Fitted:
    """Fit every candidate on the training runs and return the one with the least leave-one-out error.

    All candidates cost the same per prediction compared with a 0D or 3D run, so least variance per cost is least
    variance. For positive quantities the process of the logarithm is either chosen or the rival of the choice, which
    widens its variance (`with_rival`).

    Parameters
    ----------
    seen
        Predictors at the n training runs.
    y
        3D outputs (n,).
    simple
        Leave the Gaussian processes out.

    Returns
    -------
    Fitted
        The chosen control variate.
    """
    least_runs = {
        "constant": 0,
        "linear 0D": 5,
        "linear 0D outputs": seen.outputs.shape[1] + 4,
        "linear theta": seen.log_theta.shape[1] + 4,
        "quadratic 0D outputs": QUADRATIC_RUNS,
    }
    if seen.coarse is not None:
        least_runs |= {"linear coarse": 5, "linear coarse and 0D": 6}
    candidates = [METHODS[name](seen, y) for name, least in least_runs.items() if len(y) >= least]
    spread = y.var()
    if spread == 0:
        return candidates[0]
    logarithm = None
    if not simple and min(candidate.missed for candidate in candidates) > GOOD_ENOUGH * spread:
        candidates.append(METHODS["GP(θ, 0D)"](seen, y))
        best = min(candidate.missed for candidate in candidates)
        if len(y) >= DIRECTION_RUNS and best > DIRECTION_SHARE * spread:
            candidates.append(METHODS["GP with active direction"](seen, y))
        if len(y) >= LOGARITHM_RUNS and y.min() > 0:
            logarithm = METHODS["GP of log y"](seen, y)
    taken = candidates[0]
    for candidate in candidates[1:]:
        if candidate.missed < BETTER * taken.missed:
            taken = candidate
    if logarithm is None:
        return taken
    if logarithm.missed < BETTER * taken.missed:
        return with_rival(logarithm, taken, float(np.ptp(y)))
    return with_rival(taken, logarithm, float(np.ptp(y)))
