"""Mean, covariance and correlation of territory flows over noisy realisations."""

import numpy as np

from coronaryuq.perfusion.settings import NoiseModel
from coronaryuq.perfusion.targets import NoiseStatistics


def noise_statistics(
    noise: NoiseModel, flows: np.ndarray, volumes: np.ndarray, baseline: np.ndarray
) -> NoiseStatistics:
    """Compute the statistics of one noise model from `n` realisations.

    flows: (n, outlets) mL/s. volumes: (n, outlets) cm3. baseline: (outlets,) mL/s, flows without noise.
    """
    covariance = np.atleast_2d(np.cov(flows, rowvar=False))
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    pairs = correlation[np.triu_indices(len(baseline), 1)]
    return NoiseStatistics(
        noise=noise,
        mean=flows.mean(axis=0),
        bias=flows.mean(axis=0) / baseline - 1.0,
        covariance=covariance,
        relative_sd=deviation / baseline,
        correlation=correlation,
        correlation_min=pairs.min(initial=1.0),
        correlation_max=pairs.max(initial=-1.0),
        total_sd=flows.sum(axis=1).std(ddof=1) / baseline.sum(),
        volume_mean=volumes.mean(axis=0),
        volume_sd=volumes.std(axis=0, ddof=1),
    )


def rescaled(covariance: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Rescale a covariance to these standard deviations; correlations are kept, and the result is exactly symmetric."""
    factor = deviation / np.sqrt(np.diag(covariance))
    return covariance * np.outer(factor, factor)
