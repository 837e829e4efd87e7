"""The worth of a coarse 3D level: variance times cost with it and without, and how many runs it should have."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.estimation.results import LevelWorth, Parts, RowReport

WITHOUT = ("MC", "MFMC", "MFMC-AE", "crossfit-GP")
"""Estimators that use no coarse level."""


@dataclass(frozen=True)
class Costs:
    """Costs in fine 3D runs, of a coarse run and of a 0D run."""

    coarse: float
    cheap: float


@dataclass(frozen=True)
class Allocation:
    """Counts per fine run that give the least variance for a budget, and variance times cost there."""

    coarse: float
    cheap: float
    product: float


def allocation(parts: Parts, costs: Costs) -> Allocation:
    """Minimise (fine + coarse / r + cheap / m) (1 + r w + m w_0) over the counts r and m per fine run, r at least 1.

    r is at least 1 because the coarse level also runs the pilot. Giles 2015, equation 1: counts are proportional to the
    square root of variance over cost, and the product is the square of the sum of the roots of variance times cost. If
    the root gives fewer coarse runs than fine ones, both levels run on the same samples.
    """
    fine, coarse, per_fine = parts.fine, parts.coarse, 1.0
    if coarse > fine * costs.coarse:
        ratio, roots = np.sqrt(coarse / (costs.coarse * fine)) if fine > 0 else np.inf, [fine, coarse * costs.coarse]
    else:
        ratio, roots, per_fine = 1.0, [(fine + coarse) * (1 + costs.coarse)], 1 + costs.coarse
        fine = fine + coarse
    cheap = np.sqrt(parts.cheap * per_fine / (costs.cheap * fine)) if fine > 0 else np.inf
    product = sum(np.sqrt(value) for value in [*roots, parts.cheap * costs.cheap]) ** 2
    return Allocation(float(ratio), float(cheap), float(product))


def worth(row: RowReport, n_coarse: int, costs: Costs) -> LevelWorth | None:
    """Return what the coarse level gained for one row at the counts that were run; None without one.

    without: the estimator with the smallest standard error among those that use no coarse level. std_ratio: standard
    standard deviation with the level over that. gain: variance times cost without the level over the same with it;
    above 1 the level has paid, if the error without it falls as one over the square root of the fine runs.
    optimal_runs_per_fine: the optimum for these variances.
    """
    if row.levels is None:
        return None
    n = row.estimators["MC"].n_3d
    without = min((name for name in WITHOUT if name in row.estimators), key=lambda name: row.estimators[name].std)
    zerod = costs.cheap * row.n_propagation
    variance, variance_without = (row.estimators[name].std ** 2 for name in ("multilevel", without))
    cost_without = n * (1 + costs.cheap) + zerod
    cost = cost_without + n_coarse * costs.coarse + max(0, n_coarse - n) * costs.cheap
    return LevelWorth(
        without,
        std_ratio=(variance / variance_without) ** 0.5,
        gain=variance_without * cost_without / (variance * cost),
        optimal_runs_per_fine=allocation(row.levels, costs).coarse,
    )
