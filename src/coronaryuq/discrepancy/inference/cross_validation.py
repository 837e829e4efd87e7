"""Cross-validation: misfit and predictive density of models on held-out data."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from coronaryuq.core.block_bootstrap import root_mean_square_interval
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.evidence import Evidence
from coronaryuq.discrepancy.inference.flexible import Posterior
from coronaryuq.discrepancy.inference.gauss_newton import Fit, Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import residual_tests

BLOCKS = 4
"""Blocks of a waveform that the bootstrap resamples."""

Folds = list[tuple[np.ndarray, np.ndarray]]
"""(train, test) rows (N,) of each fold."""


def linearise(problem: Problem, z: np.ndarray, hypothesis: Hypothesis) -> Linear:
    """Linearise a model at its fit or, if it does not run there, at the prior mean with the sizes of the fit.

    The problem keeps what was linearised: the answer, the held-out misfits and an unknown source need the same.

    Parameters
    ----------
    problem
        Measurements and model.
    z
        Parameters of the fit: (p,).
    hypothesis
        Effects of the model.

    Returns
    -------
    Linear
        Residual and sensitivities of all data, held-out ones included.

    Raises
    ------
    FloatingPointError
        If the model runs at neither point under every condition.
    """
    key = z.tobytes(), hypothesis
    for point in (z, hypothesis.at_prior_mean(z)) if key not in problem.linearised else ():
        residual = problem.whitened([(point, hypothesis)])[0]
        if np.isfinite(residual).all():
            problem.linearised[key] = Linear(point, residual, problem.sensitivity(point, residual, hypothesis))
            break
    if key not in problem.linearised:
        raise FloatingPointError("the model could not be run under every condition")
    return problem.linearised[key]


def posterior_of_all(problem: Problem, fit: Fit, hypothesis: Hypothesis) -> Posterior:
    """Return the posterior given all data, held-out ones included, of a model linearised at its fit.

    Parameters
    ----------
    problem
        Measurements and model.
    fit, hypothesis
        Fit to the fitted data, and the effects of the model.

    Returns
    -------
    Posterior
        Evidence and moments by amplitude of the flexible discrepancy.

    Raises
    ------
    FloatingPointError
        See `linearise`.
    """
    return of_all(problem, linearise(problem, fit.z, hypothesis)).lowered(fit.unreached)


def of_all(problem: Problem, model: Linear) -> Posterior:
    """Return the posterior given all data of a linear model, under the problem's own noise."""
    return problem.flexible_of_all.posterior(model.at_zero, model.jacobian)


def evidence_of_all(problem: Problem, fit: Fit, hypothesis: Hypothesis) -> Evidence:
    """Return the evidence of all data, as of `posterior_of_all`, averaged over the possible noises."""
    model = linearise(problem, fit.z, hypothesis)
    return problem.all_data.evidence(model.at_zero, model.jacobian, fit.unreached)


def predict(model: Linear, train: np.ndarray, test: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the whitened residual (m,) of the test rows after a fit to the train rows, and its covariance (m, m)."""
    at_zero, fitted = model.at_zero, model.jacobian[train]
    factor = cho_factor(np.eye(len(model.z)) + fitted.T @ fitted)
    mean = cho_solve(factor, fitted.T @ at_zero[train])
    ahead = model.jacobian[test]
    return at_zero[test] - ahead @ mean, np.eye(len(ahead)) + ahead @ cho_solve(factor, ahead.T)


@dataclass(frozen=True)
class Gap:
    """Misfit of one model on held-out data.

    misfit: root mean square of the residuals whitened by noise and predictive spread, 1 by noise alone, with a 90 %
    interval; residual: those residuals (m,) in the order of the folds; rmse: by quantity, CGS; lpd, total_lpd: log
    predictive density per row and of all, nats.
    """

    misfit: float
    interval: tuple[float, float]
    rmse: dict[str, float]
    lpd: float
    total_lpd: float
    residual: np.ndarray

    def summary(self) -> dict:
        """Return the entry of `discrepancy.json`."""
        return {
            "misfit": self.misfit,
            "interval_90": list(self.interval),
            "rmse": self.rmse,
            "log_predictive_density_per_row": self.lpd,
        }


def gap(problem: Problem, model: Linear, folds: Folds, seed: int) -> Gap:
    """Compute the held-out misfit of a model over all folds.

    Parameters
    ----------
    problem
        Measurements.
    model
        The model, linearised.
    folds
        Rows of each fold; test rows do not overlap.
    seed
        Seed of the bootstrap interval.

    Returns
    -------
    Gap
        Misfit, its interval, and predictive density.
    """
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    density = 0.0
    for train, test in folds:
        residual, covariance = predict(model, train, test)
        factor = cho_factor(covariance, lower=True)
        independent = solve_triangular(factor[0], residual, lower=True)
        density += -0.5 * float(independent @ independent) - float(np.log(np.diag(factor[0])).sum())
        density -= float(np.log(problem.sd[test]).sum()) + 0.5 * len(residual) * np.log(2 * np.pi)
        parts.append((independent, residual * problem.sd[test], np.flatnonzero(test)))
    residual, raw, rows = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    quantities = np.array([s.quantity for s in problem.forward.measured])[problem.owner[rows]]
    rmse = {q: float(np.sqrt(np.mean(raw[quantities == q] ** 2))) for q in dict.fromkeys(quantities)}
    return Gap(
        float(np.sqrt(np.mean(residual**2))),
        root_mean_square_interval(residual, _quarters(problem, rows), generator(seed, "discrepancy", "gap")),
        rmse,
        density / len(rows),
        density,
        residual,
    )


@dataclass(frozen=True)
class Gaps:
    """Held-out misfit of recalibration alone, of the hypothesis, of a flexible discrepancy, and of both together."""

    before: Gap
    after: Gap
    flexible: Gap
    both: Gap


def predictive_p(problem: Problem, model: Linear, folds: Folds) -> float:
    """Return the p-value of held-out residuals under a model's predictions.

    Predictions have the spread that remains after a fit to the other rows. The smallest p-value of `residual_tests`
    over all folds, times their number (Bonferroni).
    """
    p_values: list[float] = []
    for train, test in folds:
        residual, covariance = predict(model, train, test)
        factor = cho_factor(covariance)
        score = cho_solve(factor, residual)
        tests = residual_tests(problem, test, residual @ score, score, partial(cho_solve, factor))
        p_values += tests.values()
    return min(1.0, len(p_values) * min(p_values))


def held_out(problem: Problem, fit: Fit, hypothesis: Hypothesis, folds: Folds, seed: int) -> tuple[Gap, Gap, float]:
    """Return the held-out misfit of a model, the same with a flexible discrepancy, and `predictive_p`.

    The discrepancy has its most probable amplitude.
    """
    model = linearise(problem, fit.z, hypothesis)
    flexible = model.extended(fit.posterior.amplitude * gp_discrepancy.features(problem))
    return gap(problem, model, folds, seed), gap(problem, flexible, folds, seed), predictive_p(problem, model, folds)


def _quarters(problem: Problem, rows: np.ndarray) -> np.ndarray:
    """Return the number of the block of each row (m,): a quarter of a waveform, or another row alone."""
    block, offset = np.zeros(len(rows), dtype=int), 0
    for owner in np.unique(problem.owner[rows]):
        own = np.flatnonzero(problem.owner[rows] == owner)
        for part in np.array_split(own, min(BLOCKS, len(own))):
            block[part] = offset
            offset += 1
    return block


def folds_of(problem: Problem, held_out: list[str]) -> Folds:
    """Return the declared held-out conditions as one fold; without any, each condition in turn; of one, each series.

    Means of a held-out condition that lists a free parameter set that parameter, and are not tested.

    Parameters
    ----------
    problem
        Measurements.
    held_out
        Names of the held-out conditions.

    Returns
    -------
    list of (train, test)
        Rows (N,) of each fold that tests anything.
    """
    names = list(dict.fromkeys(problem.condition))
    if len(names) == 1 and not held_out:
        return [(problem.owner != number, problem.owner == number) for number in np.unique(problem.owner)]
    groups = [held_out] if held_out else [[name] for name in names]
    folds = []
    for group in groups:
        outside = np.isin(problem.condition, group)
        anchors = problem.anchors(group)
        folds.append((~outside | anchors, outside & ~anchors))
    return [(train, test) for train, test in folds if test.any()]
