"""Monte Carlo and two-model multi-fidelity Monte Carlo for a mean, in closed form.

Arrays: `y` (n,) 3D outputs on the pilot samples, `q` (n,) 0D outputs on the same samples, in the same order; `q_more`
(m,) 0D outputs on the propagation samples, drawn independently of the pilot. N_3D = n, and N_0D = n + m counts every
0D run. Variances are of the estimator unless a name says otherwise. Source: Ng and Willcox 2014; Peherstorfer,
Willcox and Gunzburger 2016, lemma 3.3 and section 3; the paper's equations for Q_MC, Q_MFMC, alpha, var and the
optimal allocation.
"""

import numpy as np

from coronaryuq.estimation.results import Interval


def correlation(y: np.ndarray, q: np.ndarray) -> float:
    """Return Pearson's correlation of two samples; 0 if one of them is constant."""
    y, q = y - np.mean(y), q - np.mean(q)
    scale = np.sqrt(np.sum(y**2) * np.sum(q**2))
    return float(np.sum(y * q) / scale) if scale > 0 else 0.0


def monte_carlo_variance(y: np.ndarray, ddof: int = 1) -> float:
    """var[Q] / N_3D. The paper divides by N (`ddof=0`)."""
    return float(np.var(y, ddof=ddof) / len(y))


def control_coefficient(y: np.ndarray, q: np.ndarray) -> float:
    """alpha = cov(Q_3D, Q_0D) / var[Q_0D]; 0 if the 0D output is constant."""
    spread = np.sum((q - q.mean()) ** 2)
    return float(np.sum((y - y.mean()) * (q - q.mean())) / spread) if spread > 0 else 0.0


def mfmc_variance(variance_y: float, rho: float, n_3d: float, n_0d: float) -> float:
    """var[Q_MFMC] = var[Q_3D] / N_3D · (1 − (1 − N_3D / N_0D) rho²), for the optimal alpha and N_0D >= N_3D."""
    return variance_y / n_3d * (1 - (1 - n_3d / n_0d) * rho**2)


def optimal_ratio(cost_ratio: float, rho: float) -> float:
    """gamma = N_0D / N_3D that minimises the variance of MFMC for a budget; never below 1, infinite for |rho| = 1.

    `cost_ratio` w: cost of a 0D run in 3D runs.
    """
    if rho**2 >= 1:
        return np.inf
    return max(1.0, float(np.sqrt(rho**2 / (cost_ratio * (1 - rho**2)))))


def optimal_allocation(budget: float, cost_ratio: float, rho: float) -> tuple[float, float]:
    """(N_3D, N_0D), real numbers, for a `budget` in 3D runs: N_3D = B / (1 + w gamma), N_0D = gamma N_3D."""
    gamma = optimal_ratio(cost_ratio, rho)
    if np.isinf(gamma):
        return 0.0, budget / cost_ratio
    n_3d = budget / (1 + cost_ratio * gamma)
    return n_3d, gamma * n_3d


def optimal_variance(variance_y: float, budget: float, cost_ratio: float, rho: float) -> float:
    """Variance of MFMC under its optimal allocation: var / B · (sqrt(1 − rho²) + sqrt(w rho²))² where gamma > 1."""
    if rho**2 >= 1:
        return variance_y * cost_ratio / budget
    return mfmc_variance(variance_y, rho, *optimal_allocation(budget, cost_ratio, rho))


def additional_budget(
    variance_y: float, rho: float, n_3d: float, n_0d: float, cost_ratio: float, wanted: float
) -> tuple[float, float, float]:
    """Least extra cost from (N_3D, N_0D) down to variance `wanted`: (cost in 3D runs, more 3D runs, more 0D runs).

    With A = var (1 − rho²) and B = var rho² the variance is A / N_3D + B / N_0D: the free optimum has
    N_0D = gamma N_3D; if it has fewer runs of one kind than exist, that number is kept and the other kind makes up for
    it.
    """
    residual, explained = variance_y * (1 - rho**2), variance_y * rho**2
    if residual / n_3d + explained / n_0d <= wanted:
        return 0.0, 0.0, 0.0
    gamma = np.sqrt(explained / (cost_ratio * residual)) if residual > 0 else np.inf
    free_3d = (residual + (explained / gamma if gamma > 0 else 0.0)) / wanted if np.isfinite(gamma) else 0.0
    free_0d = gamma * free_3d if np.isfinite(gamma) else explained / wanted
    if free_3d < n_3d:
        free_3d, free_0d = n_3d, explained / (wanted - residual / n_3d)
    elif free_0d < n_0d:
        free_3d, free_0d = residual / (wanted - explained / n_0d), n_0d
    more_3d, more_0d = free_3d - n_3d, free_0d - n_0d
    return float(more_3d + cost_ratio * more_0d), float(more_3d), float(more_0d)


def chebyshev(mean: float, variance: float, level: float = 0.95) -> Interval:
    """Chebyshev's interval: mean ± sqrt(variance / (1 − level)), valid for any distribution whose variance is right."""
    half = np.sqrt(variance / (1 - level))
    return Interval(float(mean - half), float(mean + half), level)
