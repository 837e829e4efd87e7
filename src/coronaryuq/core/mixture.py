"""Moments of a mixture of distributions."""

import numpy as np


def mixture_moments(weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (p,) and covariance (p, p) of a mixture.

    Parameters
    ----------
    weights, means, covariances
        Of the components: (n,), which add up to 1, (n, p) and (n, p, p).
    """
    mean = weights @ means
    moved = means - mean
    within = np.einsum("t,tij->ij", weights, covariances)
    return mean, within + np.einsum("t,ti,tj->ij", weights, moved, moved)
