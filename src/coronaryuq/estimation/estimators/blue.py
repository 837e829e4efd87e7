"""Multilevel best linear unbiased estimator of several models' means, from groups of models run on the same samples.

Schaden and Ullmann 2020. With two models and the groups {3D, 0D} and {0D} it is MFMC with the optimal alpha; any
coarse 3D mesh or further 0D output is one more model. Approximate control variates with the same groups cannot do
better.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Group:
    """Runs of some models on common samples: models (l,) indices, outputs (m, l), columns in the order of `models`."""

    models: tuple[int, ...]
    outputs: np.ndarray


def blue(groups: Sequence[Group], covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (L,) of all models that some group runs, and their covariance (L, L); NaN for a model that no group runs.

    `covariance` (L, L) of the models' outputs, from runs that are not in `groups` or known: the estimator is unbiased
    then, and its claimed variance true as far as the covariance is. Groups are independent of each other.
    """
    size = len(covariance)
    precision, weighted = np.zeros((size, size)), np.zeros(size)
    for group in groups:
        at = np.ix_(group.models, group.models)
        inverse = np.linalg.pinv(covariance[at], rcond=1e-12, hermitian=True)
        precision[at] += len(group.outputs) * inverse
        weighted[list(group.models)] += inverse @ group.outputs.sum(axis=0)
    run = sorted({model for group in groups for model in group.models})
    spread = np.full((size, size), np.nan)
    spread[np.ix_(run, run)] = np.linalg.pinv(precision[np.ix_(run, run)], rcond=1e-14, hermitian=True)
    means = np.full(size, np.nan)
    means[run] = spread[np.ix_(run, run)] @ weighted[run]
    return means, spread


def blue_variance(counts: dict[tuple[int, ...], float], covariance: np.ndarray, model: int = 0) -> float:
    """Variance of one model's mean for `counts` of samples per group, before any run; for allocating a budget."""
    precision = np.zeros_like(covariance, dtype=float)
    for models, count in counts.items():
        at = np.ix_(models, models)
        precision[at] += count * np.linalg.pinv(covariance[at], rcond=1e-12, hermitian=True)
    run = sorted({m for models in counts for m in models})
    inverse = np.linalg.pinv(precision[np.ix_(run, run)], rcond=1e-14, hermitian=True)
    return float(inverse[run.index(model), run.index(model)])
