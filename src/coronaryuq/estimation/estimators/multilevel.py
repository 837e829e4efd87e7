"""Several models at once: cross-fitted multilevel BLUE, and approximate control variates, over 0D outputs and meshes.

Runs fall into groups: models that were run on the same samples. Both estimators are sums over groups of weights times
the models' means; the weights need the models' covariance. Within fold k they come from the pilot without fold k, so
the estimate is unbiased whatever they are, and its variance is that of a weighted sum of independent group means.
"""

from collections.abc import Sequence

import numpy as np

from coronaryuq.estimation.estimators.blue import Group
from coronaryuq.estimation.estimators.crossfit import Estimate, Propagated, combine
from coronaryuq.estimation.estimators.folds import assign


def blue_weights(counts: Sequence[tuple[tuple[int, ...], float]], covariance: np.ndarray) -> list[np.ndarray]:
    """Weight of every model's mean in every group, for the best linear unbiased estimate of the mean of model 0.

    counts: (models, samples) per group. The weights of model 0 add up to one over groups, those of any other to zero.
    Schaden and Ullmann 2020, equation of the estimator.
    """
    size = len(covariance)
    inverses = [np.linalg.pinv(covariance[np.ix_(m, m)], rcond=1e-12, hermitian=True) for m, _ in counts]
    precision = np.zeros((size, size))
    for (models, count), inverse in zip(counts, inverses, strict=True):
        precision[np.ix_(models, models)] += count * inverse
    run = sorted({model for models, _ in counts for model in models})
    row = np.zeros(size)
    row[run] = np.linalg.pinv(precision[np.ix_(run, run)], rcond=1e-14, hermitian=True)[run.index(0)]
    return [count * row[list(m)] @ inverse for (m, count), inverse in zip(counts, inverses, strict=True)]


def acv_variance(covariance: np.ndarray, n: int, ratios: Sequence[float]) -> float:
    """Variance of the approximate control variate ACV-MF with optimal coefficients.

    Model 0 has n runs, model j ratios[j − 1] · n of them, nested. Gorodetsky et al. 2020, theorem 6:
    (var − aᵀ (C ∘ F)⁻¹ a) / n, a = diag(F) ∘ c, F_ij = 1 − 1 / min(r_i, r_j), c the covariances with model 0 and C
    those among the others.
    """
    least = np.minimum.outer(ratios, ratios).astype(float)
    f = (least - 1) / least
    a = np.diag(f) * covariance[0, 1:]
    gain = a @ np.linalg.pinv(covariance[1:, 1:] * f, hermitian=True) @ a
    return float((covariance[0, 0] - gain) / n)


def estimate(groups: Sequence[Group], folds: int, seed: int, level: float = 0.95) -> Estimate:
    """Cross-fitted multilevel BLUE of the mean of model 0. The first group runs every model: it is the pilot.

    Every run of the pilot must have ended in every model; other groups must not run model 0. Each group is shared out
    among folds; the fold's weights meet the fold's samples.
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
        first, *rest = blue_weights(counts, covariance)
        # y enters with weight one, as no other group runs model 0: what the pilot takes off it is the control variate.
        held[fold == k] = y[fold == k] - pilot.outputs[fold == k] @ first
        values = [g.outputs[part == k] @ w for g, part, w in zip(others, parts, rest, strict=True)]
        blocks.append(Propagated(values[0], also=tuple(values[1:])) if values else Propagated(np.zeros(1)))
    return combine("multilevel BLUE", y, held, blocks, fold, sum(m for _, m in counts), level, beta=1.0)
