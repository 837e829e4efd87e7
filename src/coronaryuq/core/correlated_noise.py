"""Correlated noise as white noise and a few shapes with standard normal weights."""

import numpy as np

SMOOTH = 2.0
"""Variance of a shape of correlated noise, over that of the white remainder, above which it gets a separate weight."""


def autoregressive(count: int, correlation: float, random: np.random.Generator) -> np.ndarray:
    """Draw noise of unit standard deviation with some correlation of successive samples, (count,)."""
    noise = random.standard_normal(count)
    for k in range(1, count if correlation else 0):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1.0 - correlation**2) * noise[k]
    return noise


def around_the_beat(time: np.ndarray, period: float, correlation_time: float) -> np.ndarray:
    """Return correlations (k, k) of samples by their distance around the beat, whose starting point is irrelevant."""
    apart = np.abs(time[:, None] - time[None, :]) % period
    return np.exp(-np.minimum(apart, period - apart) / correlation_time)


def white_and_shapes(correlation: np.ndarray, smooth: float = SMOOTH) -> tuple[float, np.ndarray]:
    """Decompose noise of unit standard deviation with some correlations (k, k).

    Parameters
    ----------
    correlation
        Correlations.
    smooth
        As `SMOOTH`; the nearer to 1, the nearer are white part and shapes to the correlations.

    Returns
    -------
    white, shapes
        Standard deviation of the white part, and shapes (n, k), largest first.
    """
    variances, shapes = np.linalg.eigh(correlation)
    # Of two samples at one place one variance is zero, but for rounding.
    variances, shapes = np.maximum(variances[::-1], 0.0), shapes.T[::-1]
    rest = np.cumsum(variances[::-1])[::-1] / np.arange(variances.size, 0, -1)
    count = int(np.argmax(variances <= smooth * rest))
    white = rest[count]
    return float(np.sqrt(white)), shapes[:count] * np.sqrt(variances[:count] - white)[:, None]
