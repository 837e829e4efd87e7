"""How far the model's own time steps put its predictions off, and how surely that is known."""

from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.predict import Forward

FINER, FINEST = 8, 32
"""How many times as short steps the model's are compared with; and those with, where they differ among points."""
DRAWS, MORE, FEW, SPREAD = 16, 32, 2, 0.5
"""Points at which steps are compared, the model as it is and draws of the nuisance parameters about it: so many, and,
where the change differs from one to the next, so many, and so few with the shortest steps."""
SHAPED = 0.3
"""Norm, in noise standard deviations, from which what differs from point to point is a shape of its own."""
OWN = 3
"""Shapes at most that each series has besides, for what the common ones leave of it."""


@dataclass(frozen=True)
class TimeSteps:
    """What steps `FINER` times as short change of every prediction, CGS.

    change: mean (N,); shapes: what differs most from point to point, of all rows and then of single series, (k, N),
    with standard normal weights; sd: of the rest (N,), for every row by itself.
    """

    change: np.ndarray
    shapes: np.ndarray
    sd: np.ndarray


def time_steps(forward: Forward, noise: np.ndarray) -> TimeSteps:
    """Compare steps at some points of the prior. noise: standard deviations of the data (N,).

    A valve opens and shuts between two steps, and vessels that store blood ring afterwards: what the steps make of that
    is no disagreement with the measurements. What is alike from one point to the next is put right. What is not is no
    noise of each row on its own, but has few shapes, that of an effect perhaps, such as a valve that damps the ringing:
    those get weights, and so have the shapes of what still shorter steps change. The rest is what other points would
    leave: the worst shapes of each series get weights too, and each row of the series, as noise, the root mean square
    along the worst shape that is left. Where the change is alike at all points, the shorter steps' own error is, to
    first order, the share of it that they are of the others.
    """
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((MORE, len(forward.nuisances)))
    points[0] = 0.0
    compare = _Steps(forward, noise)
    change = compare.change(points[:DRAWS], 1, FINER)
    if len(change) < 3:
        # Where next to nothing runs, all that is known of the change is its size.
        return TimeSteps(np.zeros(forward.size), np.zeros((0, forward.size)), noise * np.abs(change).sum(axis=0))
    further, left = change.mean(axis=0)[None, :] / FINER, np.zeros((0, forward.size))
    differs = _shapes(change - change.mean(axis=0))[0].max() > SHAPED
    if differs:
        change = np.vstack([change, compare.change(points[DRAWS:], 1, FINER)])
        finest = compare.change(points[:FEW], FINER, FINEST)
        further = finest if len(finest) == FEW else further
        left = _left_by_others(change)
    mean = change.mean(axis=0)
    common, rest = [], [left]
    for deviations in (change - mean, further):
        lengths, shapes = _shapes(deviations)
        kept = (lengths > SHAPED) & differs
        common.append(shapes[kept])
        rest.append(shapes[~kept])
    own, sd = _each_series(forward, np.vstack(rest), OWN if differs else 0)
    return TimeSteps(noise * mean, noise * np.vstack([*common, own]), noise * sd)


def finer(forward: Forward, times: int) -> Forward:
    """The same model with so many times as many time steps a cycle."""
    steps = times * forward.simulation.steps_per_cycle
    return replace(forward, simulation=forward.simulation.changed(steps_per_cycle=steps))


class _Steps:
    """Predictions, in noise standard deviations, by steps so many times as short as the model's."""

    def __init__(self, forward: Forward, noise: np.ndarray):
        self.forwards, self.noise = {1: forward}, noise

    def change(self, points: np.ndarray, steps: int, finer: int) -> np.ndarray:
        """From ones to others, (n, N), at those of the points (n, p) where both run."""
        change = self._predicted(points, finer) - self._predicted(points, steps)
        return change[np.isfinite(change).all(axis=1)] / self.noise

    def _predicted(self, points: np.ndarray, times: int) -> np.ndarray:
        if times not in self.forwards:
            self.forwards[times] = finer(self.forwards[1], times)
        return self.forwards[times].predict(points)


def _each_series(forward: Forward, rest: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Worst shapes (k, N) of each series' columns of (n, N), and the standard deviations (N,) that hold the others."""
    own, sd, first = [], np.zeros(forward.size), 0
    for block in forward.split(rest):
        rows = slice(first, first + block.shape[1])
        lengths, shapes = _shapes(block * np.sqrt(len(block)))
        count = min(most, int((lengths > SHAPED).sum()), len(lengths) - 1)
        own.append(np.zeros((count, forward.size)))
        own[-1][:, rows] = shapes[:count]
        sd[rows], first = lengths[count], rows.stop
    return np.vstack(own), sd


def _shapes(deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (k,) and shapes (k, N), so long, of the root mean square of the rows of (n, N)."""
    _, lengths, directions = np.linalg.svd(deviations / np.sqrt(len(deviations)), full_matrices=False)
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
