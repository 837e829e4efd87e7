"""The most probable state, by damped Gauss-Newton steps: where an emulator is needed, and how wide it has to be."""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.posterior.model.flow_model import Posterior

STEP = 0.1
"""Of a standard normal coordinate, for central differences: well above the error of a run's period."""
ROUNDS = 25
ENOUGH = 1e-2
"""Fall of the negative log density below which the search ends."""


@dataclass(frozen=True)
class MostProbable:
    """x (d,), flows (N,) there in mL/s and their derivatives (N, d), and the model runs that it took."""

    x: np.ndarray
    flows: np.ndarray
    slope: np.ndarray
    runs: int


def most_probable(posterior: Posterior, start: np.ndarray) -> MostProbable:
    """Minimise the misfit and the prior of a posterior whose coordinates are standard normal in the prior.

    Steps that do not lower the negative log density are damped, as by Levenberg and Marquardt. The coordinate of a
    choice stays where it is.

    Parameters
    ----------
    posterior
        Its space has a prior precision of 1 throughout.
    start
        (d,), where the model runs.

    Raises
    ------
    RuntimeError
        If the model fails at `start`.
    """
    likelihood, runs = posterior.likelihood, 0

    def cost(x: np.ndarray, flows: np.ndarray) -> np.ndarray:
        found = 0.5 * np.sum(x**2, axis=1) - likelihood.log_density(flows)
        return np.where(np.isfinite(found), found, np.inf)

    x, damping = start.copy(), 1e-3
    flows = posterior.flows(x[None])
    least = float(cost(x[None], flows)[0])
    if not np.isfinite(least):
        raise RuntimeError("the model fails where its flows have the target fractions")
    for _ in range(ROUNDS):
        slope = _slope(posterior, x)
        runs += 2 * len(x) + 1
        with threadpool_limits(1):
            by = likelihood.derivative(flows[0], slope)
            precision = by.T @ by + np.eye(len(x))
            downhill = -(likelihood.gradient(flows[0], slope) + x)
            # Several dampings at once: one batch of runs, and no ranks that wait.
            dampings = damping * 10.0 ** np.arange(-1, 5)
            steps = [np.linalg.solve(precision + d * np.diag(np.diag(precision)), downhill) for d in dampings]
        tried = x + np.array(steps)
        found = posterior.flows(tried)
        runs += len(tried)
        costs = cost(tried, found)
        best = int(np.argmin(costs))
        fall = least - costs[best]
        if fall > 0:
            x, flows, least, damping = tried[best], found[best : best + 1], float(costs[best]), float(dampings[best])
        if fall < ENOUGH:
            break
    return MostProbable(x, flows[0], _slope(posterior, x), runs + 2 * len(x))


def _slope(posterior: Posterior, x: np.ndarray) -> np.ndarray:
    """Return the derivatives (N, d) of the flows; zero for choices, and where a run fails."""
    moves = STEP * np.eye(len(x))
    found = posterior.flows(np.vstack([x + moves, x - moves]))
    above, below = found[: len(x)], found[len(x) :]
    slope = np.where(np.isfinite(above) & np.isfinite(below), (above - below) / (2 * STEP), 0.0).T
    laws = posterior.space.laws
    slope[:, [len(x) - len(laws) + column for column in laws.choices]] = 0.0
    return slope
