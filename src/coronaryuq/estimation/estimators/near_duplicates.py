"""Samples closer to each other than chance allows, found by cells of a grid.

A tree of all dimensions compares nearly every pair where there are a dozen, because few of its boxes are apart.
"""

import numpy as np

from coronaryuq.core.jit import njit

CHANCE = 1e-3
"""Expected number of pairs of independent samples that are taken for near-duplicates."""
MOST_CELLS = 1000
"""Cells along one direction."""


def near_duplicates(values: np.ndarray) -> np.ndarray:
    """Return a label (m,) for each row of standardised `values` (m, d); rows closer than chance allows share one.

    Among independent normal samples, CHANCE pairs are expected to lie as close in every principal component.
    """
    m = len(values)
    _, scale, axes = np.linalg.svd(values - values.mean(axis=0), full_matrices=False)
    kept = scale > 1e-6 * scale[0]
    whitened = (values @ axes[kept].T) / (scale[kept] / np.sqrt(m))
    radius = np.sqrt(np.pi) * (CHANCE / (m * (m - 1) / 2)) ** (1 / kept.sum())
    return linked(whitened, min(radius, 0.1))


def linked(points: np.ndarray, radius: float) -> np.ndarray:
    """Return the component (m,) of each of m points (m, d), where points no further apart than `radius` are linked.

    The distance is the largest difference of a coordinate. Components are numbered in the order of their first points.
    """
    m, d = points.shape
    x = np.column_stack([points, np.zeros((m, max(0, 3 - d)))])
    reach = np.ptp(x[:, :2], axis=0)
    side = np.maximum(radius * (1 + 1e-9), reach / MOST_CELLS)
    cell = np.floor((x[:, :2] - x[:, :2].min(axis=0)) / np.where(side > 0, side, 1.0)).astype(np.int64)
    columns = int(cell[:, 1].max()) + 1
    number = cell[:, 0] * columns + cell[:, 1]
    order = np.lexsort((x[:, 2], number))
    starts = np.searchsorted(number[order], np.arange((int(cell[:, 0].max()) + 1) * columns + 1))
    first = np.arange(m)
    _link(x[order], order, starts, columns, radius, first)
    return np.unique(first, return_inverse=True)[1]


@njit(cache=True)
def _root(first: np.ndarray, i: int) -> int:
    while first[i] != i:
        first[i] = first[first[i]]
        i = first[i]
    return i


@njit(cache=True)
def _link(x: np.ndarray, order: np.ndarray, starts: np.ndarray, columns: int, radius: float, first: np.ndarray) -> None:
    """Set `first` (m,) to the first point of each point's component.

    x (m, d): points `order` (m,), by cell and then by the third coordinate. starts: of each cell in x.
    """
    for own in range(len(starts) - 1):
        for i in range(starts[own], starts[own + 1]):
            for step in range(5):
                # This cell and half of its neighbours: the others look here.
                row, column = own // columns + (step > 1), own % columns + (0, 1, -1, 0, 1)[step]
                other = row * columns + column
                if column < 0 or column >= columns or other >= len(starts) - 1:
                    continue
                low, high = starts[other], starts[other + 1]
                if step == 0:
                    low = i + 1
                else:
                    end = high
                    while low < end:
                        middle = (low + end) // 2
                        if x[i, 2] - x[middle, 2] > radius:
                            low = middle + 1
                        else:
                            end = middle
                for j in range(low, high):
                    if x[j, 2] - x[i, 2] > radius:
                        break
                    close = True
                    for k in range(x.shape[1]):
                        if abs(x[i, k] - x[j, k]) > radius:
                            close = False
                            break
                    if close:
                        a, b = _root(first, order[i]), _root(first, order[j])
                        first[max(a, b)] = min(a, b)
    for i in range(len(first)):
        first[i] = _root(first, i)
