"""Have the chains converged, is the emulator good enough? R-hat, effective sample sizes, Pareto k, and a verdict."""

import numpy as np

from coronaryuq.posterior.results import Diagnosis


def split_rhat(draws: np.ndarray) -> np.ndarray:
    """Return the rank-normalised split R-hat (N,) of `draws` (chains, n, N)."""
    from arviz_stats.base import array_stats

    # Chains that have not moved have no variance.
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.array([float(array_stats.rhat(draws[:, :, i], method="rank")) for i in range(draws.shape[2])])


def effective_size(draws: np.ndarray, kind: str) -> np.ndarray:
    """Return the effective sample size (N,) of `draws` (chains, n, N), `kind` "bulk" or "tail"."""
    from arviz_stats.base import array_stats

    quantiles = (0.05, 0.95) if kind == "tail" else None
    sizes = [array_stats.ess(draws[:, :, i], method=kind, prob=quantiles) for i in range(draws.shape[2])]
    return np.array(sizes, dtype=float)


def pareto_smoothed(log_ratio: np.ndarray) -> tuple[float, np.ndarray]:
    """Return Pareto k and smoothed weights (n,), of sum one, of log importance ratios (n,) (Vehtari et al. 2024).

    k below 0.7: averages with these weights are reliable. It is 0 for equal ratios and nan if there are too few.
    """
    from arviz_stats.base import array_stats

    uniform = np.full(len(log_ratio), 1.0 / len(log_ratio))
    finite = log_ratio[np.isfinite(log_ratio)]
    if len(finite) < len(log_ratio) / 2 or len(log_ratio) < 25:
        return np.nan, uniform
    if np.ptp(finite) < 1e-9 and len(finite) == len(log_ratio):
        return 0.0, uniform
    log_weight, k_hat = array_stats.psislw(-log_ratio)
    weight = np.exp(log_weight)
    return float(k_hat), weight / weight.sum()


def good_enough(k_hat: float, weights: np.ndarray, limit: float) -> bool:
    """Return whether draws with these Pareto k and smoothed weights (n,) stand for the target.

    Their effective share 1 / (n sum w^2) must be above a fifth: few runs can miss a heavy tail. Where the largest
    weight is less than twice the mean, the shape of their tail does not matter: the autocorrelation time of a chain of
    such proposals is then less than three (Mengersen and Tweedie, Ann. Stat. 24, 1996).
    """
    share = 1.0 / (len(weights) * np.sum(weights**2))
    return bool(np.isfinite(k_hat) and share > 0.2 and (k_hat < limit or np.max(weights) * len(weights) < 2.0))


def diagnose(draws: np.ndarray, names: list[str], rhat_limit: float, ess_limit: float) -> Diagnosis:
    """Return a verdict on `draws` (chains, n, N) of parameters `names` (Vehtari et al. 2021)."""
    rhat, bulk, tail = split_rhat(draws), effective_size(draws, "bulk"), effective_size(draws, "tail")
    worst = int(np.argmax(np.where(np.isfinite(rhat), rhat, np.inf)))
    poorest = int(np.argmin(np.minimum(bulk, tail)))
    least = float(min(bulk[poorest], tail[poorest]))
    converged = bool(np.all(rhat < rhat_limit) and least > ess_limit)
    reasons = []
    if not rhat[worst] < rhat_limit:
        reasons.append(f"R-hat of {names[worst]} is {rhat[worst]:.3f}, should be below {rhat_limit}")
    if not least > ess_limit:
        reasons.append(f"effective sample size of {names[poorest]} is {least:.0f}, should be above {ess_limit:.0f}")
    verdict = f"converged; worst is {names[worst]} with R-hat {rhat[worst]:.3f}"
    return Diagnosis(
        converged=converged,
        verdict=verdict if converged else "not converged: " + "; ".join(reasons) + "; lengthen the chains",
        worst_parameter=names[worst],
        rhat_max=float(rhat[worst]),
        rhat=dict(zip(names, rhat.tolist(), strict=True)),
        ess_bulk=dict(zip(names, bulk.tolist(), strict=True)),
        ess_tail=dict(zip(names, tail.tolist(), strict=True)),
        ess_bulk_min=float(bulk.min()),
        ess_tail_min=float(tail.min()),
    )
