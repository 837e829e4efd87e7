"""Errors of predictions that were evaluated at draws of the prior, as few shapes with weights and a remaining noise."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.discrepancy.forward.predict import Forward

SHAPED = 0.3
"""Norm, in noise standard deviations, above which a difference between draws is a separate shape."""
OWN = 3
"""Maximum number of further shapes per series, for its part that common shapes do not describe."""


def principal(deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths (k,) and shapes (k, N): principal components of the rows of (n, N)."""
    _, lengths, directions = np.linalg.svd(deviations / np.sqrt(len(deviations)), full_matrices=False)
    return lengths, lengths[:, None] * directions


def described(
    forward: Forward, sets: Sequence[np.ndarray], left: np.ndarray, least: float = SHAPED
) -> tuple[np.ndarray, np.ndarray]:
    """Describe sets of deviations by shapes, and by noise where these do not suffice.

    Principal components longer than `least` get weights. Of what they leave, and of `left`, the worst shapes of each
    series also get weights, and each row gets the root mean square along the worst remaining shape as noise.

    Parameters
    ----------
    forward
        The model.
    sets
        Deviations at draws, (n, N) each, in noise standard deviations.
    left
        What other draws do not explain of each, (m, N); see `left_by_others`.
    least
        Infinite: no shapes.

    Returns
    -------
    shapes, sd
        With standard normal weights, (k, N), and the standard deviation of the rest, independent between rows: (N,).
    """
    common, rest = [], [left]
    for deviations in sets:
        lengths, shapes = principal(deviations)
        common.append(shapes[lengths > least])
        rest.append(shapes[lengths <= least])
    own, sd = _each_series(forward, np.vstack(rest), OWN if np.isfinite(least) else 0)
    return np.vstack([*common, own]), sd


def left_by_others(draws: np.ndarray) -> np.ndarray:
    """Return the part of each row of (n, N) that mean and shapes of the others do not explain, over the root of n."""
    left = []
    for number, row in enumerate(draws):
        others = np.delete(draws, number, axis=0)
        shapes = (others - others.mean(axis=0)) / np.sqrt(len(others) - 1)
        missing = row - others.mean(axis=0)
        weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ missing)
        left.append(missing - weights @ shapes)
    return np.array(left) / np.sqrt(len(left))


def _each_series(forward: Forward, rest: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the worst shapes (k, N) of each series in (n, N), and standard deviations (N,) that cover the others."""
    own, sd = [], np.zeros(forward.size)
    for rows in forward.rows:
        lengths, shapes = principal(rest[:, rows] * np.sqrt(len(rest)))
        count = min(most, int((lengths > SHAPED).sum()), len(lengths) - 1)
        own.append(np.zeros((count, forward.size)))
        own[-1][:, rows] = shapes[:count]
        sd[rows] = lengths[count]
    return np.vstack(own), sd
