"""Have the chains converged? R-hat, effective sample sizes, and a verdict."""

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
