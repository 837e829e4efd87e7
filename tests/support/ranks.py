"""Ranks of simulation-based calibration (Talts et al. 2018)."""

import numpy as np
from scipy import stats


def uniformity(ranks, chains):
    """p-value of each column's ranks 0..chains being uniform, in bins of equal width."""
    bins = np.array_split(np.arange(chains + 1), 13)
    p_values = []
    for column in ranks.T:
        counts = np.array([np.isin(column, bin_).sum() for bin_ in bins])
        expected = len(column) * np.array([len(bin_) for bin_ in bins]) / (chains + 1)
        p_values.append(stats.chisquare(counts, expected).pvalue)
    return np.array(p_values)
