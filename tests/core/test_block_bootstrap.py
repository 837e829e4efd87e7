"""Bootstrap of blocks: its interval covers as stated, also for values that are equal within blocks."""

import numpy as np
from scipy import stats

from coronaryuq.core.block_bootstrap import root_mean_square_interval

TRIALS, BLOCKS = 400, 60


def test_the_interval_of_a_root_mean_square_covers_it_in_nine_of_ten_trials():
    """Values are the same within a block; a bootstrap of single values covers in half of them."""
    random, covered = np.random.default_rng(0), 0
    blocks = np.repeat(np.arange(BLOCKS), 5)
    for _ in range(TRIALS):
        low, high = root_mean_square_interval(random.standard_normal(BLOCKS)[blocks], blocks, random)
        covered += low <= 1.0 <= high
    # Percentile intervals of a mean of 60 skewed squares cover a few per cent less than stated.
    assert stats.binom.ppf(0.001, TRIALS, 0.85) <= covered <= stats.binom.ppf(0.999, TRIALS, 0.92)
