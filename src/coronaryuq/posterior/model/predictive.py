"""Posterior predictive checks: do simulated flows and their covariance match the targets (paper, Figs. 2b and A.2)?"""

import numpy as np

from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.results import Predictive, TotalFlow


def given_total(covariance: np.ndarray) -> np.ndarray:
    """Covariance of a Gaussian vector given the sum of its entries.

    Total resistance is preserved, and so, nearly, is total flow: simulated flows can reproduce this covariance, not the
    targets' own.
    """
    to_sum = covariance.sum(axis=1)
    return covariance - np.outer(to_sum, to_sum) / to_sum.sum()


def check(
    flows: np.ndarray, likelihood: Likelihood, names: list[str], random: np.random.Generator, total_free: bool = False
) -> Predictive:
    """Compare draws of `flows` (n, N), mL/s in the unit of the targets, with the targets of the likelihood.

    coverage_95: fraction of targets within the central 95 % of simulated flows plus measurement noise (a target lies
    there with probability 0.95 or more if the model holds). mahalanobis: of the mean simulated flow from the
    targets under the targets' covariance. p_value: probability that new data lie further from the simulated flows than
    the targets do. sd_ratio, correlation_rms: simulated covariance against the targets', given their total unless it is
    free.
    """
    replicated = likelihood.replicated(flows, random)
    low, high = np.quantile(replicated, [0.025, 0.975], axis=0)
    inside = (likelihood.mean >= low) & (likelihood.mean <= high)
    mean, covariance = flows.mean(axis=0), np.cov(flows, rowvar=False)
    expected = likelihood.covariance if total_free else given_total(likelihood.covariance)
    far = np.sum(likelihood.whitened(flows) ** 2, axis=1)
    far_replicated = np.sum(likelihood.whitened(flows, replicated) ** 2, axis=1)
    pairs = np.triu_indices(len(names), 1)
    simulated_correlation, expected_correlation = _correlation(covariance)[pairs], _correlation(expected)[pairs]
    fraction, wanted = flows / flows.sum(axis=1, keepdims=True), likelihood.mean / likelihood.mean.sum()
    total = flows.sum(axis=1)
    return Predictive(
        coverage_95=float(inside.mean()),
        outside_95=[name for name, within in zip(names, inside, strict=True) if not within],
        mahalanobis=float(np.sqrt(np.sum(likelihood.whitened(mean[None]) ** 2))),
        mean_squared_mahalanobis=float(far.mean()),
        p_value=float(np.mean(far_replicated >= far)),
        relative_error_of_mean=dict(zip(names, (mean / likelihood.mean - 1.0).tolist(), strict=True)),
        largest_fraction_error=float(np.max(np.abs(fraction.mean(axis=0) / wanted - 1.0))),
        flow_mean=mean.tolist(),
        flow_sd=np.sqrt(np.diag(covariance)).tolist(),
        flow_covariance=covariance.tolist(),
        target_mean=likelihood.mean.tolist(),
        target_covariance=likelihood.covariance.tolist(),
        target_covariance_given_total=expected.tolist(),
        sd_ratio=np.sqrt(np.diag(covariance) / np.diag(expected)).tolist(),
        correlation_rms=float(np.sqrt(np.mean((simulated_correlation - expected_correlation) ** 2))),
        correlation_of_correlations=_pearson(simulated_correlation, expected_correlation),
        covariance_error=float(np.linalg.norm(covariance - expected) / np.linalg.norm(expected)),
        total_flow=TotalFlow(float(likelihood.mean.sum()), float(total.mean()), float(total.std())),
    )


def _correlation(covariance: np.ndarray) -> np.ndarray:
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


def _pearson(a: np.ndarray, b: np.ndarray) -> float | None:
    if len(a) < 3 or np.std(a) == 0 or np.std(b) == 0:
        return None
    return float(np.corrcoef(a, b)[0, 1])
