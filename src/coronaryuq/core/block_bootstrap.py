"""Bootstrap of blocks: intervals of statistics of values that are correlated within blocks."""

import numpy as np

RESAMPLES = 400


def root_mean_square_interval(
    values: np.ndarray, blocks: np.ndarray, random: np.random.Generator
) -> tuple[float, float]:
    """Return the 90 % percentile interval of a root mean square.

    Parameters
    ----------
    values
        (n,).
    blocks
        Number of the block of each value, from 0 without gaps: (n,), int.
    random
        Draws the blocks.
    """
    sums, counts = np.bincount(blocks, values**2), np.bincount(blocks)
    draws = random.integers(0, len(sums), (RESAMPLES, len(sums)))
    means = np.sqrt(sums[draws].sum(axis=1) / counts[draws].sum(axis=1))
    low, high = np.quantile(means, [0.05, 0.95])
    return float(low), float(high)
