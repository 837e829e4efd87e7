"""Targets with known moments for tests of samplers, and checks that their draws have them."""

import numpy as np


def no_output(log_density):
    return lambda x: (log_density(x), np.zeros((len(x), 0)))


def ess(draws):
    from arviz_stats.base import array_stats

    thinned = draws[:: max(1, len(draws) // 400)]
    return np.array([float(array_stats.ess(thinned[:, :, i].T)) for i in range(draws.shape[2])])


def assert_moments(draws, mean, covariance, sigmas=4.5):
    """Mean and variances agree within their own standard errors, from effective sample sizes."""
    flat = draws.reshape(-1, draws.shape[2])
    variance = np.diag(covariance)
    n = ess(draws)
    assert np.all(np.abs(flat.mean(axis=0) - mean) < sigmas * np.sqrt(variance / n))
    n_squared = ess((draws - mean) ** 2)
    spread = np.var((flat - mean) ** 2, axis=0)
    assert np.all(np.abs(np.mean((flat - mean) ** 2, axis=0) - variance) < sigmas * np.sqrt(spread / n_squared))


def gaussian(d, correlation=0.5, seed=2):
    random = np.random.default_rng(seed)
    deviation = np.exp(random.uniform(-1, 1, size=d))
    covariance = (correlation + (1 - correlation) * np.eye(d)) * np.outer(deviation, deviation)
    mean = random.normal(size=d)
    precision = np.linalg.inv(covariance)
    return mean, covariance, lambda x: -0.5 * np.einsum("ni,ij,nj->n", x - mean, precision, x - mean)


def overdispersed(mean, covariance, chains, seed=3):
    return np.random.default_rng(seed).multivariate_normal(mean, 4 * covariance, size=chains)


def exchange_asymmetry(advance, target, repeats=300):
    """z-scores of E[f(x) g(x') - g(x) f(x')] for one step x to x' from exact draws: zero under detailed balance.

    advance: takes a seed and x, draws of `target` (mean, covariance, log density); returns the movers' x and x'.
    """
    mean, covariance, _ = target
    random = np.random.default_rng(11)
    precision = np.linalg.inv(covariance)
    functions = [lambda x: np.ones(len(x)), lambda x: np.einsum("ni,ij,nj->n", x - mean, precision, x - mean),
                 lambda x: x[:, 0], lambda x: x[:, 0] ** 2, lambda x: x[:, 1] ** 3, lambda x: x[:, 0] > mean[0] + 0.5,
                 lambda x: np.prod(x, axis=1), lambda x: np.sum(x**2, axis=1)]  # fmt: skip
    values = []
    for seed in range(repeats):
        x, after = advance(seed, random.multivariate_normal(mean, covariance, size=24))
        values.append([
            np.mean(f(x) * g(after) - g(x) * f(after)) for i, f in enumerate(functions) for g in functions[:i]
        ])  # fmt: skip
    values = np.array(values)
    return values.mean(axis=0) / (values.std(axis=0, ddof=1) / np.sqrt(repeats))
