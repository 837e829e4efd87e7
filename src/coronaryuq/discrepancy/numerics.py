"""How far the model's own time steps put its predictions off, and how surely that is known."""

from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.discrepancy.forward import Forward
from coronaryuq.seeds import generator

FINER = 8
DRAWS, MORE, SPREAD = 16, 32, 0.5
"""Points at which steps are compared, the model as it is and draws of the nuisance parameters about it; so many more
where the change differs from one to the next."""
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
    """Compare steps at some points of the prior. noise: standard deviations of the data (N,).

    A valve opens and shuts between two steps, and vessels that store blood ring afterwards: what the steps make of that
    is no disagreement with the measurements. What is alike from one point to the next is put right. What is not is no
    noise of each row on its own, but has few shapes, that of an effect perhaps, such as a valve that damps the ringing:
    those get weights. The rest, what other points would leave and the shorter steps' own error (to first order the
    share that they are of the others), is added to the noise: each row of a series is given the root mean square that
    it has along the worst shape of the series' rows.
    """
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((MORE, len(forward.nuisances)))
    points[0] = 0.0
    finer_steps = FINER * forward.simulation.steps_per_cycle
    finer = replace(forward, simulation=forward.simulation.changed(steps_per_cycle=finer_steps))

    def changes(some: np.ndarray) -> np.ndarray:
        found = finer.predict(some) - forward.predict(some)
        return found[np.isfinite(found).all(axis=1)] / noise

    change = changes(points[:DRAWS])
    if len(change) >= 3 and _shapes(change)[0].max() > SHAPED:
        change = np.vstack([change, changes(points[DRAWS:])])
    if len(change) < 3:
        # Where next to nothing runs, all that is known of the change is its size.
        return TimeSteps(np.zeros(forward.size), np.zeros((0, forward.size)), noise * np.abs(change).sum(axis=0))
    mean = change.mean(axis=0)
    lengths, shapes = _shapes(change)
    kept = lengths > SHAPED
    left = _left_by_others(change) if kept.any() else np.zeros((0, forward.size))
    rest = np.vstack([left, shapes[~kept], mean / FINER])
    blocks = forward.split(rest)
    sd = np.repeat([np.linalg.norm(block, ord=2) for block in blocks], [block.shape[1] for block in blocks])
    return TimeSteps(noise * mean, noise * shapes[kept], noise * sd)


def _shapes(change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (k,) and shapes (k, N), so long, of what differs among the rows of (n, N)."""
    differing = (change - change.mean(axis=0)) / np.sqrt(len(change) - 1)
    _, lengths, directions = np.linalg.svd(differing, full_matrices=False)
    return lengths, lengths[:, None] * directions


def _left_by_others(change: np.ndarray) -> np.ndarray:
    """What each row of (n, N) has that the mean and the shapes of the others do not give, over the root of n."""
    left = []
    for number, one in enumerate(change):
        others = np.delete(change, number, axis=0)
        shapes = (others - others.mean(axis=0)) / np.sqrt(len(others) - 1)
        missing = one - others.mean(axis=0)
        weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ missing)
        left.append(missing - weights @ shapes)
    return np.array(left) / np.sqrt(len(left))
