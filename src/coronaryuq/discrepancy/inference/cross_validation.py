"""How far the gap shrinks on measurements kept out of every fit."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import residual_tests

BLOCKS = 4
RESAMPLES = 400


@dataclass(frozen=True)
class Linear:
    """A model linearised at its fit: residual (N,) and sensitivities (N, p) of all rows, whitened, at z (p,)."""

    z: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray

    def extended(self, features: np.ndarray) -> "Linear":
        """With further linear terms, weights standard normal a priori."""
        return Linear(
            np.concatenate([self.z, np.zeros(features.shape[1])]), self.residual, np.hstack([self.jacobian, features])
        )


def linearise(problem: Problem, z: np.ndarray, hypothesis: Hypothesis) -> Linear:
    """At the fit z (p,), or, where the model does not run there under every condition, at the prior's mean with its
    sizes. Raises FloatingPointError where it does not run there either.
    """
    centred = hypothesis.at_prior_mean(z)
    for point in (z, centred):
        residual = problem.whitened([(point, hypothesis)])[0]
        if np.isfinite(residual).all():
            return Linear(point, residual, problem.sensitivity(point, residual, hypothesis))
    raise FloatingPointError("the model could not be run under every condition")


def predict(model: Linear, train: np.ndarray, test: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whitened residual (m,) of the test rows after a fit to the train rows, and its covariance (m, m) with noise."""
    at_zero = model.residual + model.jacobian @ model.z
    fitted = model.jacobian[train]
    factor = cho_factor(np.eye(len(model.z)) + fitted.T @ fitted)
    mean = cho_solve(factor, fitted.T @ at_zero[train])
    ahead = model.jacobian[test]
    return at_zero[test] - ahead @ mean, np.eye(len(ahead)) + ahead @ cho_solve(factor, ahead.T)


@dataclass(frozen=True)
class Gap:
    """Misfit of one model on held-out rows.

    misfit: root mean square of the residuals whitened by noise and predictive spread (noise floor 1), with a 90 %
    interval; residual: those residuals, (m,) in the order of the folds;
    rmse: per quantity, CGS; lpd: log predictive density per row, nats, CGS.
    """

    misfit: float
    interval: tuple[float, float]
    rmse: dict[str, float]
    lpd: float
    total_lpd: float
    residual: np.ndarray

    def summary(self) -> dict:
        return {
            "misfit": self.misfit,
            "interval_90": list(self.interval),
            "rmse": self.rmse,
            "log_predictive_density_per_row": self.lpd,
        }


def gap(problem: Problem, model: Linear, folds: list[tuple[np.ndarray, np.ndarray]], seed: int) -> Gap:
    """Gap over all folds (train rows, test rows), whose test rows do not overlap."""
    residuals, raw, rows, density = [], [], [], 0.0
    for train, test in folds:
        residual, covariance = predict(model, train, test)
        factor = cho_factor(covariance, lower=True)
        independent = solve_triangular(factor[0], residual, lower=True)
        density += -0.5 * float(independent @ independent) - float(np.log(np.diag(factor[0])).sum())
        density -= float(np.log(problem.sd[test]).sum()) + 0.5 * len(residual) * np.log(2 * np.pi)
        raw.append(residual * problem.sd[test])
        residuals.append(independent)
        rows.append(np.flatnonzero(test))
    residual, raw, rows = np.concatenate(residuals), np.concatenate(raw), np.concatenate(rows)
    quantities = np.array([s.quantity for s in problem.forward.measured])[problem.owner[rows]]
    rmse = {q: float(np.sqrt(np.mean(raw[quantities == q] ** 2))) for q in dict.fromkeys(quantities)}
    return Gap(
        float(np.sqrt(np.mean(residual**2))),
        _interval(problem, residual, rows, seed),
        rmse,
        density / len(rows),
        density,
        residual,
    )


def better(one: Gap, other: Gap) -> bool:
    """Whether held-out density is higher by 3 nats and by half a standard error, rows grouped in eights."""
    difference = 0.5 * (other.residual**2 - one.residual**2)
    blocks = np.array([part.sum() for part in np.array_split(difference, max(2, len(difference) // 8))])
    error = np.sqrt(len(blocks) * blocks.var(ddof=1))
    return one.total_lpd - other.total_lpd > max(3.0, 0.5 * error)


def foretold(problem: Problem, model: Linear, folds: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """p-value of held-out residuals as the model foretells them, with the spread that a fit to the other rows leaves.

    The least of the tests of `residual_tests` over all folds (train rows, test rows), times their number (Bonferroni).
    """
    found = []
    for train, test in folds:
        residual, covariance = predict(model, train, test)
        factor = cho_factor(covariance)
        score = cho_solve(factor, residual)
        tests = residual_tests(problem, test, residual @ score, score, lambda v, of=factor: cho_solve(of, v))
        found += tests.values()
    return min(1.0, len(found) * min(found))


def _interval(problem: Problem, residual: np.ndarray, rows: np.ndarray, seed: int) -> tuple[float, float]:
    """Percentile interval (90 %) of the misfit by resampling blocks: quarters of a waveform, single other rows."""
    block, offset = np.zeros(len(rows), dtype=int), 0
    for owner in np.unique(problem.owner[rows]):
        mine = np.flatnonzero(problem.owner[rows] == owner)
        parts = np.array_split(mine, min(BLOCKS, len(mine)))
        for part in parts:
            block[part] = offset
            offset += 1
    sums = np.bincount(block, residual**2, minlength=offset)
    counts = np.bincount(block, minlength=offset)
    draws = generator(seed, "discrepancy", "gap").integers(0, offset, (RESAMPLES, offset))
    values = np.sqrt(sums[draws].sum(axis=1) / counts[draws].sum(axis=1))
    low, high = np.quantile(values, [0.05, 0.95])
    return float(low), float(high)


def folds(problem: Problem, held_out: list[str]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The declared held-out conditions as one fold; without any, each condition in turn.

    Mean values of a held-out condition that lists a free parameter set that parameter and are no test.
    """
    conditions = problem.forward.conditions
    means = np.array([s.statistic == "mean" for s in problem.forward.measured])[problem.owner]
    groups = [held_out] if held_out else [[name] for name in dict.fromkeys(problem.condition)]
    found = []
    for group in groups:
        outside = np.isin(problem.condition, group)
        anchored = np.isin(problem.condition, [name for name in group if conditions[name].anchored]) & means
        found.append((~outside | anchored, outside & ~anchored))
    return [(train, test) for train, test in found if test.any()]
