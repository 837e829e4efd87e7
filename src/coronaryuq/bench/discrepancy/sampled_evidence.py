"""Evidence by importance sampling about a fit, with the model as it is: what Laplace's approximation is checked by.

The parameters in which predictions are not linear are drawn from a Student t about the fit, and again with the mean and
the covariance of the weighted draws (adaptive importance sampling; Cappé et al. 2004). At every draw the weights of the
linear shapes and the amplitude of the flexible discrepancy are integrated exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from coronaryuq.core.importance_weights import pareto_smoothed
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.cross_validation import posterior_of_all
from coronaryuq.discrepancy.inference.flexible import Projection
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem

FREEDOM = 10
"""Degrees of freedom of the proposal, whose tails are heavier than those of the posterior."""
ROUNDS, DRAWS = 3, 400
"""The proposal is adapted between the rounds; the last one gives the evidence."""
LEAST = 5
"""Effective draws per parameter from which their covariance is used."""


@dataclass(frozen=True)
class Sampled:
    """An integral by importance sampling.

    Attributes
    ----------
    log_evidence, error
        Log of the integral, and its standard error.
    k_hat
        Pareto k of the ratios; below 0.7 the error can be relied on.
    effective
        Effective number of draws.
    """

    log_evidence: float
    error: float
    k_hat: float
    effective: float


LogDensity = Callable[[np.ndarray], np.ndarray]
"""Points (n, d) → log density (n,), minus infinity where there is none."""


def integrate(
    log_density: LogDensity, mean: np.ndarray, covariance: np.ndarray, random: np.random.Generator,
    draws: int = DRAWS, rounds: int = ROUNDS,
) -> Sampled:  # fmt: skip
    """Integrate a density over its space.

    Parameters
    ----------
    log_density
        Log of the density, which need not be normalised.
    mean, covariance
        First guess of its mean (d,) and covariance (d, d).
    random
        Random generator.
    draws
        Evaluations in each round.
    rounds
        Rounds; mean and covariance are those of the weighted draws of the round before.

    Returns
    -------
    Sampled
        The integral by the draws of the last round.
    """
    found = Sampled(-np.inf, np.inf, np.nan, 0.0)
    for _ in range(rounds):
        proposal = multivariate_t(mean, covariance, df=FREEDOM)
        points = proposal.rvs(draws, random_state=random).reshape(draws, len(mean))
        ratio = log_density(points) - proposal.logpdf(points)
        if not np.isfinite(ratio).any():
            return found
        k_hat, weights = pareto_smoothed(ratio)
        log_evidence = float(logsumexp(ratio) - np.log(draws))
        error = float(np.std(np.exp(ratio - log_evidence)) / np.sqrt(draws))
        found = Sampled(log_evidence, error, k_hat, float(1.0 / np.sum(weights**2)))
        mean = weights @ points
        if found.effective > LEAST * len(mean):
            moved = points - mean
            covariance = (moved.T * weights) @ moved
    return found


def sampled_evidence(
    problem: Problem, fit: Fit, hypothesis: Hypothesis, prior: np.ndarray, random: np.random.Generator
) -> Sampled:
    """Return the log evidence of all data for a hypothesis, as `posterior_of_all` approximates it.

    Parameters
    ----------
    problem, fit, hypothesis
        Measurements, and the fit of a hypothesis.
    prior
        Log prior (T,) of the amplitudes, `flexible.RIGHT` or `flexible.UNKNOWN`.
    random
        Random generator.

    Returns
    -------
    Sampled
        Up to the constant that is common to all models of the data.

    Raises
    ------
    FloatingPointError
        The model runs neither at the fit nor at the prior's mean.
    """
    columns, _ = problem.shape_weights()
    others = np.setdiff1d(np.arange(len(fit.z)), columns)
    mean, covariance = posterior_of_all(problem, fit, hypothesis).moments(prior)
    flexible = problem.flexible_of_all
    jacobian = np.zeros((len(problem.y), len(fit.z)))
    jacobian[:, columns] = flexible.shapes
    shapes = Projection(flexible, jacobian)

    def log_density(points: np.ndarray) -> np.ndarray:
        z = np.zeros((len(points), len(fit.z)))
        z[:, others] = points
        found = np.full(len(points), -np.inf)
        for k, residual in enumerate(problem.whitened([(row, hypothesis) for row in z])):
            if np.isfinite(residual).all():
                by_amplitude, _ = shapes.condition(shapes.weighted(np.ascontiguousarray(residual)))
                found[k] = logsumexp(by_amplitude + prior)
        return found - 0.5 * np.sum(points**2, axis=1) - 0.5 * len(others) * np.log(2.0 * np.pi)

    return integrate(log_density, mean[others], covariance[np.ix_(others, others)], random)
