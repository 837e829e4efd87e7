"""A flexible discrepancy: what the measurements ask for when no named effect will do, and a reference for all of them.

A Gaussian process over place, phase and condition (Kennedy & O'Hagan 2001), written as a linear model in its features:
for each measured place and quantity a constant and Fourier waves of the cycle with variance falling as (1 + h^2)^-2,
half of the variance common to all conditions, half of each condition's own; its amplitude is a share of the series'
size.
"""

import numpy as np

from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.problem import Problem

HARMONICS = 8
AMPLITUDES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
"""Shares of the series' size that the evidence averages over with equal weights."""


def features(problem: Problem) -> np.ndarray:
    """Features (N, k) of unit amplitude in whitened numbers, all rows; weights are standard normal a priori."""
    forward = problem.forward
    keys = list(dict.fromkeys((s.quantity, s.location, s.statistic) for s in forward.measured))
    conditions = list(dict.fromkeys(s.condition for s in forward.measured))
    size = {
        key: max(np.abs(s.value).max() for s in forward.measured if (s.quantity, s.location, s.statistic) == key)
        for key in keys
    }
    waves = 2 * HARMONICS + 1
    matrix = np.zeros((len(problem.y), len(keys), len(conditions) + 1, waves))
    first = 0
    for series in forward.measured:
        rows = slice(first, first + series.value.size)
        first = rows.stop
        key = (series.quantity, series.location, series.statistic)
        columns = np.zeros((series.value.size, waves))
        columns[:, 0] = 1.0
        if series.time is not None:
            for h in range(1, HARMONICS + 1):
                angle = 2 * np.pi * h * series.time / series.period
                columns[:, 2 * h - 1] = np.cos(angle) / (1 + h**2)
                columns[:, 2 * h] = np.sin(angle) / (1 + h**2)
        scaled = columns * size[key] / problem.sd[rows, None] * np.sqrt(0.5)
        matrix[rows, keys.index(key), 0] = scaled
        matrix[rows, keys.index(key), 1 + conditions.index(series.condition)] = scaled
    matrix = matrix.reshape(len(problem.y), -1)
    return matrix[:, np.abs(matrix).max(axis=0) > 0]


def gain(fit: Fit, matrix: np.ndarray) -> tuple[float, float]:
    """Log evidence of the flexible discrepancy over the model alone, and the most probable amplitude.

    matrix: features of the fitted rows, (N, k).
    """
    inner, along = matrix.T @ fit.project(matrix), matrix.T @ fit.score
    values, vectors = np.linalg.eigh(inner)
    along = vectors.T @ along
    gains = []
    for amplitude in AMPLITUDES:
        spread = 1.0 + amplitude**2 * np.maximum(values, 0.0)
        gains.append(0.5 * np.sum(amplitude**2 * along**2 / spread - np.log(spread)))
    gains = np.array(gains)
    best = gains.max()
    return float(best + np.log(np.mean(np.exp(gains - best)))), AMPLITUDES[int(np.argmax(gains))]
