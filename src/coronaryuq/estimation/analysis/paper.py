"""The paper's own numbers for a row: correlation, standard deviations of MC and MFMC, with the paper's conventions."""

import numpy as np

from coronaryuq.estimation.estimators.formulas import correlation, mfmc_variance, monte_carlo_variance
from coronaryuq.estimation.results import PaperRow

N_0D = 10_000


def paper_row(y: np.ndarray, q: np.ndarray, n_0d: int = N_0D) -> PaperRow:
    """Compute the row as the paper's table prints it: variances divided by N, `n_0d` 0D runs in all."""
    rho = correlation(y, q)
    variance = np.var(y)
    return PaperRow(
        rho,
        float(np.sqrt(monte_carlo_variance(y, ddof=0))),
        float(np.sqrt(mfmc_variance(variance, rho, len(y), max(n_0d, len(y))))),
    )
