"""Any number of models with any nesting of their samples: `coronaryuq.estimate_models` and `coronaryuq.allocate`."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from coronaryuq.core.errors import InputError
from coronaryuq.estimation.analysis import diagnostics
from coronaryuq.estimation.estimators import blue
from coronaryuq.estimation.estimators.blue import Group
from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.settings import Settings

RUNS_PER_MODEL = 10
"""Pilot runs for each cheap model beyond the second: the weights of more models are not known."""
LEAST = 0.5
"""Samples below which a subset of models is left out of an allocation."""
GAP, ITERATIONS = 1e-5, 200_000
"""Relative error of the variance of an allocation, and the largest number of steps towards it."""


def estimate_models(groups: Sequence[pd.DataFrame], level: float = 0.95, seed: int = 1) -> Estimate:
    """Estimate the mean of an expensive model from groups of samples on which different models were run.

    Cross-fitted multilevel BLUE: the linear combination of the groups' means with the least variance, with the
    covariance of the models from the part of the pilot that a fold leaves out.

    Parameters
    ----------
    groups
        A table for every group of samples, with a column for every model that was run on all of its samples. The first
        one is the pilot: it has every model, the expensive one in the first column. The others have the cheap models
        only, in any combination; their samples are independent of the pilot and of each other.
    level
        Confidence level of the interval.
    seed
        Seed of the folds.

    Returns
    -------
    Estimate
        `mean`, `std` (reported standard error), `interval`, `residual_variance` (of the pilot) and
        `propagation_variance` (of the other groups), `warnings`.

    Raises
    ------
    InputError
        If a group has a model that the pilot has not, a value that is not finite, or too few samples.
    """
    if not 0.5 < level < 1:
        raise InputError("estimate_models", "level", level, "expected a confidence level above 0.5 and below 1")
    tables = [pd.DataFrame(group).rename(columns=str).reset_index(drop=True) for group in groups]
    if not tables:
        raise InputError("estimate_models", "groups", None, "empty; the first group is the pilot")
    names, n, settings = list(tables[0].columns), len(tables[0]), Settings()
    folds = count(n, settings.folds)
    least = max(settings.min_3d, RUNS_PER_MODEL * (len(names) - 1) if len(names) > 3 else 0)
    for number, table in enumerate(tables):
        _check_group(number, table, names, least if number == 0 else 2 * folds)
    found = blue.estimate(
        [Group(tuple(names.index(name) for name in table), table.to_numpy(float)) for table in tables],
        folds, seed, level,
    )  # fmt: skip
    findings = diagnostics.unseen(n), diagnostics.skewed(found), diagnostics.without_gain(found.rho_held_out, n, "BLUE")
    for finding in findings:
        found = found.warned(finding)
    return found


def _check_group(number: int, table: pd.DataFrame, names: list[str], least: int) -> None:
    where = f"group {number}"
    if not table.columns.is_unique:
        twice = table.columns[table.columns.duplicated()][0]
        raise InputError("estimate_models", where, twice, "two columns of this name")
    if len(table) < least:
        raise InputError("estimate_models", where, len(table), f"samples; at least {least} are needed")
    for name in table:
        if name not in names:
            raise InputError("estimate_models", where, name, f"not a model of the pilot, which has {', '.join(names)}")
    if number > 0 and names[0] in table:
        remedy = "the expensive model belongs into the first group only; add these samples there, or drop the column"
        raise InputError("estimate_models", where, names[0], remedy)
    try:
        values = table.to_numpy(float)
    except (TypeError, ValueError) as error:
        raise InputError("estimate_models", where, None, f"expected numbers ({error})") from None
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        i, j = wrong[0]
        remedy = "leave this row out of the group, if failing does not depend on the inputs"
        raise InputError("estimate_models", f"{where}, row {i}, {table.columns[j]}", float(values[i, j]), remedy)


@dataclass(frozen=True)
class Allocation:
    """Numbers of samples for subsets of models that give the least variance of BLUE for a budget.

    Attributes
    ----------
    subsets
        Subsets of the models that are run, by name.
    samples
        Samples of each subset, real numbers.
    variance
        Variance of the estimated mean of the first model, in its unit squared.
    """

    subsets: tuple[tuple[str, ...], ...]
    samples: np.ndarray
    variance: float

    def table(self) -> pd.DataFrame:
        """Return the samples of every subset, one line each, and which models it runs."""
        names = list(dict.fromkeys(name for subset in self.subsets for name in subset))
        lines = [{name: name in subset for name in names} for subset in self.subsets]
        return pd.DataFrame(lines).assign(samples=self.samples)


def allocate(
    covariance: ArrayLike | pd.DataFrame,
    costs: ArrayLike,
    budget: float,
    subsets: Sequence[Sequence[Any]] | None = None,
) -> Allocation:
    """Allocate a budget to subsets of models such that the variance of the first model's mean is least.

    The problem is convex (Schaden and Ullmann 2020). With the cost share p_k of subset k, variance times budget is
    f(p) = e' (Σ p_k A_k / c_k)⁻¹ e, A_k the inverse covariance of the subset's models and c_k the cost of one of its
    samples. Each step multiplies p_k by the square root of −∂f/∂p_k over f, which never raises f (Yu 2010), until the
    duality gap, the largest −∂f/∂p_k over f minus one, is below GAP.

    Parameters
    ----------
    covariance
        Covariance (k, k) of the models' outputs, the expensive model first; a data frame's columns give names.
    costs
        Cost of a run of each model (k,), all in one unit.
    budget
        Total cost, in the same unit.
    subsets
        Subsets of models, by name or number, that may be run on common samples; None: all subsets.

    Returns
    -------
    Allocation
        Subsets with at least half a sample, and their numbers of samples.

    Raises
    ------
    InputError
        If costs or budget are not positive, the covariance is not positive definite, or no subset has the first model.

    References
    ----------
    Schaden and Ullmann, "On multilevel best linear unbiased estimators", SIAM/ASA J. Uncertain. Quantif. 8, 2020.
    Yu, "Monotonic convergence of a general algorithm for computing optimal designs", Annals of Statistics 38, 2010.
    """
    names = list(map(str, covariance.columns)) if isinstance(covariance, pd.DataFrame) else None
    matrix, prices = np.array(covariance, dtype=float), np.array(costs, dtype=float)
    names = names or [f"model_{i}" for i in range(len(matrix))]
    _check_problem(matrix, prices, budget)
    chosen = _subsets(subsets, names)
    run = sorted({model for subset in chosen for model in subset})
    scale = np.sqrt(np.diag(matrix))
    unit = matrix / np.outer(scale, scale)
    information = np.zeros((len(chosen), len(run), len(run)))
    for k, subset in enumerate(chosen):
        at = np.ix_([run.index(model) for model in subset], [run.index(model) for model in subset])
        information[k][at] = np.linalg.inv(unit[np.ix_(subset, subset)]) / prices[list(subset)].sum()
    share, product = _least(information)
    samples = budget * share / np.array([prices[list(subset)].sum() for subset in chosen])
    kept = np.flatnonzero(samples >= LEAST)
    if not any(0 in chosen[k] for k in kept):
        raise InputError("allocate", "budget", budget, f"less than the cost of one run of {names[0]}")
    return Allocation(
        tuple(tuple(names[model] for model in chosen[k]) for k in kept), samples[kept],
        float(product * matrix[0, 0] / budget),
    )  # fmt: skip


def _least(information: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the shares (K,) that minimise f, and f there; information (K, k, k): A_k / c_k, the first model first."""
    share = np.full(len(information), 1 / len(information))
    product = np.inf
    for _ in range(ITERATIONS):
        column = np.linalg.solve(np.tensordot(share, information, 1), np.eye(information.shape[1])[0])
        product, slope = float(column[0]), np.einsum("i,kij,j->k", column, information, column)
        if slope.max() <= (1 + GAP) * product:
            break
        share = share * np.sqrt(slope / product)
        share = np.maximum(share / share.sum(), 1e-14)
    return share, product


def _check_problem(covariance: np.ndarray, costs: np.ndarray, budget: float) -> None:
    k = len(covariance)
    if covariance.shape != (k, k) or not np.allclose(covariance, covariance.T):
        raise InputError("allocate", "covariance", covariance.shape, "expected a symmetric matrix")
    if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] <= 0:
        remedy = "not positive definite; leave out constant models and those that others determine"
        raise InputError("allocate", "covariance", None, remedy)
    if costs.shape != (k,) or not (costs > 0).all():
        raise InputError("allocate", "costs", costs.tolist(), f"expected {k} positive numbers")
    if not budget > 0:
        raise InputError("allocate", "budget", budget, "expected a positive number")


def _subsets(subsets: Sequence[Sequence[Any]] | None, names: list[str]) -> list[tuple[int, ...]]:
    if subsets is None:
        return [s for size in range(len(names), 0, -1) for s in combinations(range(len(names)), size)]
    found = []
    for subset in subsets:
        for model in subset:
            if model not in names and model not in range(len(names)):
                raise InputError("allocate", "subsets", model, f"no such model; there are {', '.join(names)}")
        found.append(tuple(sorted({names.index(m) if m in names else int(m) for m in subset})))
    if not any(0 in subset for subset in found):
        raise InputError("allocate", "subsets", None, f"none has {names[0]}, whose mean is wanted")
    return found
