"""Fit of the resistances to target flow fractions."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Fit:
    """multipliers and flows (N,) at the fit, flows at r-hat, largest relative error of a flow fraction, runs made."""

    multipliers: np.ndarray
    flows: np.ndarray
    flows_at_r_hat: np.ndarray
    error: float
    runs: int


def fit_fractions(
    flows: Callable[[np.ndarray], np.ndarray], weights: np.ndarray, target: np.ndarray, tolerance: float = 1e-5,
    limit: int = 40,
) -> Fit:  # fmt: skip
    """Return the multipliers, with the total resistance of r-hat, whose flow fractions are those of `target` (N,).

    A bed's flow is nearly inverse to its resistance, so m_i <- m_i f_i / target_i, rescaled, converges within a few
    runs. It stops at `tolerance`, or when the error has not fallen for three runs: a vessel cannot carry its target.
    """
    wanted = target / target.sum()
    multipliers = np.ones(len(target))
    best: Fit | None = None
    at_r_hat, stalled, runs = None, 0, 0
    while runs < limit and stalled < 3:
        simulated = flows(multipliers[None])[0]
        runs += 1
        if not np.all(np.isfinite(simulated)) or np.any(simulated <= 0):
            break
        at_r_hat = simulated if at_r_hat is None else at_r_hat
        ratio = simulated / simulated.sum() / wanted
        error = float(np.max(np.abs(ratio - 1.0)))
        stalled = 0 if best is None or error < best.error else stalled + 1
        if best is None or error < best.error:
            best = Fit(multipliers, simulated, at_r_hat, error, runs)
        if error < tolerance:
            break
        multipliers = multipliers * ratio
        multipliers = multipliers * np.sum(weights / multipliers)
    if best is None:
        raise RuntimeError("the model failed at r-hat: no flows to compare with the targets")
    return Fit(best.multipliers, best.flows, best.flows_at_r_hat, best.error, runs)
