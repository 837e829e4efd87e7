"""Correlated fields have unit variance and the stated correlation everywhere."""

import numpy as np
import pytest
from numba import njit

from coronaryuq.perfusion.fields import FieldGrid, interpolate


@njit
def _values(nodes, cell, weights):
    out = np.empty((len(cell), nodes.shape[3]), dtype=np.float32)
    for p in range(len(cell)):
        interpolate(nodes, cell[p], weights[p], out[p])
    return out


@pytest.mark.slow
@pytest.mark.parametrize("length", [0.7, 1.5])
def test_fields_have_unit_variance_and_the_stated_correlation(length):
    draws, random = 12_000, np.random.default_rng(3)
    points = np.concatenate([random.uniform(0, 2, size=(12, 3)), [[0, 0, 0], [2, 2, 2]]])
    grid = FieldGrid.for_points(points, length)
    values = np.concatenate([_values(grid.draw(random, 200), grid.cell, grid.weights) for _ in range(draws // 200)], 1)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    target = np.exp(-(distance**2) / (2 * length**2))
    standard_error = np.sqrt((1 + target**2) / draws)
    interpolation = 0.025
    assert np.all(np.abs(values @ values.T / draws - target) < 4.5 * standard_error + interpolation)
    assert np.allclose(np.var(values, axis=1), 1, atol=4.5 * np.sqrt(2 / draws))
