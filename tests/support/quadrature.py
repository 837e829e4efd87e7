"""Posteriors of a few dimensions by quadrature."""

import numpy as np

REACH = 30.0
"""Drop of the log density from its mode within which points matter."""


def cells(posterior, points, far=7.0):
    """Midpoints (m, d) of equal cells that cover a posterior, and their probabilities (m,), none of them zero.

    points: cells along each coordinate. far: bound of the standard normal coordinates.
    """
    space = posterior.space
    start = space.draw(np.random.default_rng(0), 4000)
    low, high = start.min(axis=0), start.max(axis=0)
    low, high = low - 0.1 * (high - low), high + 0.1 * (high - low)
    beds = space.basis.shape[1]
    low[beds:], high[beds:] = -far, far
    for _ in range(3):
        side = (high - low) / points
        axes = [a + s * (np.arange(points) + 0.5) for a, s in zip(low, side, strict=True)]
        grid = np.array(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1).T
        density = posterior(grid)[0]
        near = grid[density > density.max() - REACH]
        low, high = near.min(axis=0) - side, near.max(axis=0) + side
    mass = np.exp(density - density.max())
    kept = mass > 0
    return grid[kept], mass[kept] / mass.sum()


def moments(mass, values):
    """Mean and standard deviation of values (m, k) over cells of probabilities (m,)."""
    mean = mass @ values
    return mean, np.sqrt(mass @ (values - mean) ** 2)


def below(mass, values, near):
    """Values (k,) between two cells, near the probabilities `near` (k,), and the exact probability below each."""
    order = np.argsort(values)
    values, cumulated = values[order], np.cumsum(mass[order])
    # Between the last cell with some value and the first with the next one.
    steps = np.append(np.flatnonzero(np.diff(values) > 1e-9 * np.ptp(values)), len(values) - 1)
    chosen = np.clip(np.searchsorted(cumulated[steps], near), 0, len(steps) - 2)
    return 0.5 * (values[steps[chosen]] + values[steps[chosen + 1]]), cumulated[steps[chosen]]
