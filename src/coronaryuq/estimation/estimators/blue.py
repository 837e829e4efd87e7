"""Cross-fitted multilevel BLUE (best linear unbiased estimator) over 0D outputs and meshes.

Runs fall into groups: models that were run on the same samples. The estimate is a sum over groups of weights times the
models' means; the weights need the models' covariance. Within fold k they come from the pilot without fold k, so the
estimate is unbiased whatever they are, and its variance is that of a weighted sum of independent group means. With two
models and the groups {3D, 0D} and {0D} it is MFMC with the optimal alpha; approximate control variates with the same
groups cannot do better (Schaden and Ullmann 2020).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.estimation.estimators.crossfit import CrossFit, Estimate, Options, Propagated, combine
from coronaryuq.estimation.estimators.dependence import INDEPENDENT, Dependence
from coronaryuq.estimation.estimators.folds import assign

LEAST = 1e-10
"""Smallest eigenvalue of a correlation matrix, over the largest."""


@dataclass(frozen=True)
class Group:
    """Runs of some models on common samples: models (l,) indices, outputs (m, l), columns in the order of `models`."""

    models: tuple[int, ...]
    outputs: np.ndarray


def weights(counts: Sequence[tuple[tuple[int, ...], float]], covariance: np.ndarray) -> list[np.ndarray]:
    """Weight of every model's mean in every group, for the best linear unbiased estimate of the mean of model 0.

    counts: (models, samples) per group. The weights of model 0 add up to one over groups, those of any other to zero.
    Schaden and Ullmann 2020, equation of the estimator, for models divided by their standard deviations.
    """
    size, scale = len(covariance), np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    correlation = covariance / np.outer(scale, scale)
    inverses = [_inverse(correlation[np.ix_(m, m)]) for m, _ in counts]
    precision = np.zeros((size, size))
    for (models, count), inverse in zip(counts, inverses, strict=True):
        precision[np.ix_(models, models)] += count * inverse
    run = sorted({model for models, _ in counts for model in models})
    row = np.zeros(size)
    row[run] = np.linalg.pinv(precision[np.ix_(run, run)], rcond=1e-14, hermitian=True)[run.index(0)]
    return [
        count * row[list(m)] @ inverse * (scale[0] / scale[list(m)])
        for (m, count), inverse in zip(counts, inverses, strict=True)
    ]


def _inverse(correlation: np.ndarray) -> np.ndarray:
    """Invert a correlation matrix with its eigenvalues raised to LEAST times the largest.

    Models of which one is a linear combination of others have an eigenvalue of zero: that combination is known exactly.
    A pseudo-inverse would treat it as unknown.
    """
    values, vectors = np.linalg.eigh(correlation)
    return (vectors / np.maximum(values, LEAST * values[-1])) @ vectors.T


def estimate(
    groups: Sequence[Group], folds: int, seed: int, level: float = 0.95, dependence: Dependence = INDEPENDENT
) -> Estimate:
    """Cross-fitted multilevel BLUE of the mean of model 0. The first group runs every model: it is the pilot.

    Every run of the pilot must have succeeded in every model; other groups must not run model 0. Each group is shared
    out among folds; a fold's weights apply to the fold's samples. dependence: of the pilot's runs.
    """
    # Constants off the cheap models' outputs change no estimate, and keep folds of unlike weights on one level.
    centre = dict(zip(groups[0].models, groups[0].outputs.mean(axis=0), strict=True)) | {0: 0.0}
    pilot, *others = (Group(g.models, g.outputs - [centre[m] for m in g.models]) for g in groups)
    n = len(pilot.outputs)
    fold = assign(n, folds, seed, "multilevel")
    parts = [assign(len(g.outputs), folds, seed, "multilevel", str(i)) for i, g in enumerate(others)]
    counts = [(g.models, len(g.outputs)) for g in groups]
    y = pilot.outputs[:, pilot.models.index(0)]
    held, blocks = np.empty(n), []
    for k in range(folds):
        covariance = np.cov(pilot.outputs[fold != k][:, np.argsort(pilot.models)], rowvar=False)
        first, *rest = weights(counts, covariance)
        # y enters with weight one, as no other group runs model 0: what the pilot takes off it is the control variate.
        held[fold == k] = y[fold == k] - pilot.outputs[fold == k] @ first
        values = [g.outputs[part == k] @ w for g, part, w in zip(others, parts, rest, strict=True)]
        blocks.append(Propagated(values[0], also=tuple(values[1:])) if values else Propagated(np.zeros(1)))
    n_0d = sum(count for _, count in counts)
    return combine(
        "multilevel BLUE", CrossFit(y, held, blocks, fold, dependence), n_0d, Options(level, beta=1.0, in_order=False)
    )
