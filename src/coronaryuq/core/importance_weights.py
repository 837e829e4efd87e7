"""Importance weights: Pareto k, smoothed weights, and whether they are good enough."""

import numpy as np


def pareto_smoothed(log_ratio: np.ndarray) -> tuple[float, np.ndarray]:
    """Return Pareto k and smoothed weights (n,), of sum one, of log importance ratios (n,) (Vehtari et al. 2024).

    k below 0.7: averages with these weights are reliable. It is 0 for equal ratios and nan if there are too few.
    """
    from arviz_stats.base import array_stats

    uniform = np.full(len(log_ratio), 1.0 / len(log_ratio))
    finite = log_ratio[np.isfinite(log_ratio)]
    if len(finite) < len(log_ratio) / 2 or len(log_ratio) < 25:
        return np.nan, uniform
    if np.ptp(finite) < 1e-9 and len(finite) == len(log_ratio):
        return 0.0, uniform
    log_weight, k_hat = array_stats.psislw(-log_ratio)
    weight = np.exp(log_weight)
    return float(k_hat), weight / weight.sum()


def good_enough(k_hat: float, weights: np.ndarray, limit: float) -> bool:
    """Return whether draws with these Pareto k and smoothed weights (n,) stand for the target.

    Their effective share 1 / (n sum w^2) must be above a fifth: few runs can miss a heavy tail. Where the largest
    weight is less than twice the mean, the shape of their tail does not matter: the autocorrelation time of a chain of
    such proposals is then less than three (Mengersen and Tweedie, Ann. Stat. 24, 1996).
    """
    share = 1.0 / (len(weights) * np.sum(weights**2))
    return bool(np.isfinite(k_hat) and share > 0.2 and (k_hat < limit or np.max(weights) * len(weights) < 2.0))
