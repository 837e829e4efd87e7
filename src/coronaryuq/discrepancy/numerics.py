"""How far the model's own time steps put its predictions off, and how surely that is known."""

from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.discrepancy.forward import Forward
from coronaryuq.seeds import generator

FINER = 8
DRAWS, SPREAD = 8, 0.5
"""Points at which steps are compared: the model as it is, and draws of the nuisance parameters about it."""


@dataclass(frozen=True)
class TimeSteps:
    """What steps `FINER` times as short change of every prediction: mean (N,) and standard deviation (N,), CGS."""

    change: np.ndarray
    sd: np.ndarray


def time_steps(forward: Forward) -> TimeSteps:
    """Change of predictions with the time steps, over `DRAWS` points; its sd is the widest of neighbouring times.

    A valve opens and shuts between two steps, and vessels that store blood ring afterwards: what the steps make of that
    is no disagreement with the measurements. What is alike from one point to the next is put right. What is not is no
    noise of each row on its own: it may have the shape of an effect, such as a valve that damps the ringing. Errors s
    of the n rows of a waveform have variance n s^2 at most along any shape, whatever their own; each row is given that.
    """
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((DRAWS, len(forward.nuisances)))
    points[0] = 0.0
    finer_steps = FINER * forward.simulation.steps_per_cycle
    finer = replace(forward, simulation=forward.simulation.changed(steps_per_cycle=finer_steps))
    change = finer.predict(points) - forward.predict(points)
    change = change[np.isfinite(change).all(axis=1)]
    if len(change) < 2:
        # Where next to nothing runs, all that is known of the change is its size.
        size = np.abs(change).sum(axis=0)
        return TimeSteps(np.zeros(forward.size), size)
    # A further point differs from the mean of n by the spread and by the error of that mean; the shorter steps' own
    # error is, to first order, the share that they are of the others'.
    mean, spread = change.mean(axis=0), change.std(axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / len(change))
    blocks = forward.split(np.hypot(spread, mean / FINER)[None, :])
    return TimeSteps(mean, np.concatenate([np.sqrt(block.size) * _widest(block[0]) for block in blocks]))


def _widest(values: np.ndarray) -> np.ndarray:
    """Largest of each value and its two neighbours, the cycle closed."""
    return np.max([np.roll(values, shift) for shift in (-1, 0, 1)], axis=0)
