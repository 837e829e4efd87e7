"""How far the model's own time steps put its predictions off, as a standard deviation of every row of the data."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.forward import Forward
from coronaryuq.seeds import generator

FINER = 4
DRAWS, SPREAD = 3, 0.5
"""Points at which steps are compared: the model as it is, and draws of the nuisance parameters about it."""


def time_step_error(forward: Forward) -> np.ndarray:
    """Root mean square change (N,) of predictions on steps `FINER` times as short, CGS; widest of neighbouring times.

    A valve opens and shuts between two steps, and vessels that store blood ring afterwards: what the steps make of that
    is no disagreement with the measurements, and differs from one run to the next.
    """
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((DRAWS, len(forward.nuisances)))
    points[0] = 0.0
    finer_steps = FINER * forward.simulation.steps_per_cycle
    finer = replace(forward, simulation=forward.simulation.changed(steps_per_cycle=finer_steps))
    change = forward.predict(points) - finer.predict(points)
    change = change[np.isfinite(change).all(axis=1)]
    if not len(change):
        return np.zeros(forward.size)
    blocks = forward.split(np.sqrt(np.mean(change**2, axis=0))[None, :])
    return np.concatenate([_widest(block[0]) for block in blocks])


def _widest(values: np.ndarray) -> np.ndarray:
    """Largest of each value and its two neighbours, the cycle closed."""
    return np.max([np.roll(values, shift) for shift in (-1, 0, 1)], axis=0)
