"""How far the model's own time steps put its predictions off, and how surely that is known."""

from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.discrepancy.forward import Forward
from coronaryuq.seeds import generator

FINER = 8
DRAWS, SPREAD = 16, 0.5
"""Points at which steps are compared: the model as it is, and draws of the nuisance parameters about it."""
SHAPED = 0.3
"""Norm, in noise standard deviations, from which what differs from point to point is a shape of its own."""


@dataclass(frozen=True)
class TimeSteps:
    """What steps `FINER` times as short change of every prediction, CGS.

    change: mean (N,); shapes: what differs most from point to point, (k, N), with standard normal weights; sd: of the
    rest (N,), for every row by itself.
    """

    change: np.ndarray
    shapes: np.ndarray
    sd: np.ndarray


def time_steps(forward: Forward, noise: np.ndarray) -> TimeSteps:
    """Compare steps at `DRAWS` points. noise: standard deviations of the data (N,).

    A valve opens and shuts between two steps, and vessels that store blood ring afterwards: what the steps make of that
    is no disagreement with the measurements. What is alike from one point to the next is put right. What is not is no
    noise of each row on its own, but has few shapes, that of an effect perhaps, such as a valve that damps the ringing:
    those get weights. What other points would leave, and the shorter steps' own error (to first order the share that
    they are of the others), has variance n s^2 at most along any shape of a waveform's n rows; each row is given that.
    """
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((DRAWS, len(forward.nuisances)))
    points[0] = 0.0
    finer_steps = FINER * forward.simulation.steps_per_cycle
    finer = replace(forward, simulation=forward.simulation.changed(steps_per_cycle=finer_steps))
    change = finer.predict(points) - forward.predict(points)
    change = change[np.isfinite(change).all(axis=1)] / noise
    if len(change) < 3:
        # Where next to nothing runs, all that is known of the change is its size.
        return TimeSteps(np.zeros(forward.size), np.zeros((0, forward.size)), noise * np.abs(change).sum(axis=0))
    mean = change.mean(axis=0)
    _, lengths, directions = np.linalg.svd((change - mean) / np.sqrt(len(change) - 1), full_matrices=False)
    shapes = lengths[:, None] * directions
    kept = lengths > SHAPED
    left = _left_by_others(change) if kept.any() else np.zeros(forward.size)
    rest = np.sqrt(left**2 + np.sum(shapes[~kept] ** 2, axis=0) + (mean / FINER) ** 2)
    blocks = forward.split(rest[None, :])
    sd = np.concatenate([np.sqrt(block.size) * _widest(block[0]) for block in blocks])
    return TimeSteps(noise * mean, noise * shapes[kept], noise * sd)


def _left_by_others(change: np.ndarray) -> np.ndarray:
    """Root mean square (N,) of what each row of (n, N) has that the mean and the shapes of the others do not give."""
    left = []
    for number, one in enumerate(change):
        others = np.delete(change, number, axis=0)
        shapes = (others - others.mean(axis=0)) / np.sqrt(len(others) - 1)
        missing = one - others.mean(axis=0)
        weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ missing)
        left.append(missing - weights @ shapes)
    return np.sqrt(np.mean(np.square(left), axis=0))


def _widest(values: np.ndarray) -> np.ndarray:
    """Largest of each value and its two neighbours, the cycle closed."""
    return np.max([np.roll(values, shift) for shift in (-1, 0, 1)], axis=0)
