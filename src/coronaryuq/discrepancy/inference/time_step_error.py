"""Time-step error: the change of predictions by the time steps, and its uncertainty."""

from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.drawn_errors import SHAPED, described, left_by_others, principal

FINER, FINEST = 8, 32
"""Refinements of the time steps for the comparison, and those used if points differ."""
DRAWS, MORE, FEW, SPREAD = 16, 32, 2, 0.5
"""Number of points at which steps are compared (the plain model, and draws of the nuisance parameters with standard
deviation `SPREAD`); number in all, and with the finest steps, if the change differs between points."""


@dataclass(frozen=True)
class TimeSteps:
    """Change of predictions by steps `FINER` times as short, CGS.

    change: mean (N,); shapes: largest differences between points, of all rows and then of single series, (k, N), with
    standard normal weights; sd: standard deviation of the rest (N,), independent between rows; varies: length of the
    largest difference between points, in noise standard deviations.
    """

    change: np.ndarray
    shapes: np.ndarray
    sd: np.ndarray
    varies: float = 0.0


def time_steps(forward: Forward, noise: np.ndarray) -> TimeSteps:
    """Estimate the time-step error by comparing steps at points of the prior.

    Valves open and close between two steps, and vessels that store blood then oscillate: the time-step error there is
    no misfit of the model. The part common to all points is corrected. The rest is not independent noise of each row
    but has few shapes, perhaps those of an effect, such as a valve that damps the oscillation: these get weights, as do
    the shapes of the change by still shorter steps. Of what remains at other points, the worst shapes of each series
    also get weights, and each row gets the root mean square along the worst remaining shape as noise. If the change is
    the same at all points, the error of the shorter steps is, to first order, the same fraction of it as their length.

    Parameters
    ----------
    forward
        The model.
    noise
        Standard deviations of the data: (N,), CGS.

    Returns
    -------
    TimeSteps
        Correction, shapes and remaining standard deviations.
    """
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((MORE, len(forward.nuisances)))
    points[0] = 0.0
    compare = _Steps(forward, noise)
    change = compare.change(points[:DRAWS], 1, FINER)
    if len(change) < 3:
        # If the model runs at few points, only the size of the change is known.
        return TimeSteps(np.zeros(forward.size), np.zeros((0, forward.size)), noise * np.abs(change).sum(axis=0))
    further, left = change.mean(axis=0)[None, :] / FINER, np.zeros((0, forward.size))
    differs = principal(change - change.mean(axis=0))[0].max() > SHAPED
    if differs:
        change = np.vstack([change, compare.change(points[DRAWS:], 1, FINER)])
        finest = compare.change(points[:FEW], FINER, FINEST)
        further = finest if len(finest) == FEW else further
        left = left_by_others(change)
    mean = change.mean(axis=0)
    shapes, sd = described(forward, (change - mean, further), left, SHAPED if differs else np.inf)
    return TimeSteps(noise * mean, noise * shapes, noise * sd, float(principal(change - mean)[0].max()))


def finer(forward: Forward, times: int) -> Forward:
    """Return the model with more time steps per cycle by a factor."""
    steps = times * forward.simulation.steps_per_cycle
    return replace(forward, simulation=forward.simulation.changed(steps_per_cycle=steps))


class _Steps:
    """Predictions with refined time steps, in noise standard deviations."""

    def __init__(self, forward: Forward, noise: np.ndarray) -> None:
        self.forwards, self.noise = {1: forward}, noise

    def change(self, points: np.ndarray, steps: int, finer: int) -> np.ndarray:
        """Return the change (n, N) from one refinement to another, at the points (n, p) where both run."""
        change = self._predicted(points, finer) - self._predicted(points, steps)
        return change[np.isfinite(change).all(axis=1)] / self.noise

    def _predicted(self, points: np.ndarray, times: int) -> np.ndarray:
        if times not in self.forwards:
            self.forwards[times] = finer(self.forwards[1], times)
        return self.forwards[times].predict(points)
