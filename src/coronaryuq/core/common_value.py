"""One value common to several data sets: its posterior from the normal posteriors that each gives alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats


@dataclass(frozen=True)
class CommonValue:
    """The posterior of a common value, and whether it is one.

    Attributes
    ----------
    mean, covariance
        Moments: (k,), (k, k).
    log_overlap
        Log evidence of the data with one value, less that with a value of each data set's own.
    agreement
        p-value of equal values in all data sets.
    """

    mean: np.ndarray
    covariance: np.ndarray
    log_overlap: float
    agreement: float


def common_value(means: Sequence[np.ndarray], covariances: Sequence[np.ndarray]) -> CommonValue:
    """Combine normal posteriors under the same standard normal prior, which counts once.

    Parameters
    ----------
    means, covariances
        Of each data set: (k,), (k, k).

    Returns
    -------
    CommonValue
        Mean, covariance, evidence and agreement.
    """
    precisions = [np.linalg.inv(one) for one in covariances]
    pulls = [precision @ mean for precision, mean in zip(precisions, means, strict=True)]
    data = [_of_data(precision) for precision in precisions]
    covariance = np.linalg.inv(np.eye(len(pulls[0])) + sum(data))
    mean = covariance @ sum(pulls)
    alone = [own @ pull - np.linalg.slogdet(p)[1] for own, pull, p in zip(means, pulls, precisions, strict=True)]
    log_overlap = 0.5 * (sum(pulls) @ mean + np.linalg.slogdet(covariance)[1] - sum(alone))
    return CommonValue(mean, covariance, float(log_overlap), _agreement(data, pulls))


def _of_data(precision: np.ndarray) -> np.ndarray:
    """Return the part (k, k) of a posterior's precision that the data have, without that of the prior."""
    values, vectors = np.linalg.eigh(precision - np.eye(len(precision)))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def _agreement(data: Sequence[np.ndarray], pulls: Sequence[np.ndarray]) -> float:
    """Return the p-value of equal values: without the common prior, those of each data set are independent."""
    common = np.linalg.pinv(sum(data)) @ sum(pulls)
    off = [np.linalg.pinv(own) @ pull - common for own, pull in zip(data, pulls, strict=True)]
    distance = sum(one @ own @ one for one, own in zip(off, data, strict=True))
    return float(stats.chi2.sf(distance, len(common) * (len(data) - 1)))
