"""Losses of the 0D vessels by which the 0D model meets the mean pressures of 3D runs.

Each piece of the domain gets a linear and a quadratic loss, added to its own: dP = (R + r) Q + (S + s) |Q| Q. A linear
one stands for friction that differs from that of a straight tube with a developed profile, a quadratic one for
separation, turbulence and gains or losses of kinetic energy where the vessel changes its width. The data are mean
pressures over the aortic one, of all places and runs; the 0D model, whose response to a loss is almost linear, is run
with its own inflow and outlets, so that flows follow. Prior and noise are normal; the noise's variance is the one of
largest evidence (MacKay 1992).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

Model = Callable[[np.ndarray], np.ndarray]
"""Standardised losses (k, p) → mean pressures over the aortic one (k, n, m), of n runs at m places."""

ITERATIONS = 3
STEP = 0.05
"""Difference for the derivatives, in prior standard deviations: well above the tolerance of a periodic run."""
FIRST_SD = 1e-3
"""Standard deviation of a pressure over the aortic one in the first iteration."""


@dataclass(frozen=True)
class LossFit:
    """Standardised losses (p,), their covariance (p, p), and residuals (n, m) of pressure over aortic pressure.

    before: without losses. after: with them. left_out: with those of all other runs, to first order.
    """

    mean: np.ndarray
    covariance: np.ndarray
    before: np.ndarray
    after: np.ndarray
    left_out: np.ndarray


def fit_losses(model: Model, measured: np.ndarray, lowest: np.ndarray) -> LossFit:
    """Fit the losses to the pressures of 3D runs.

    Parameters
    ----------
    model
        The 0D model at the inputs of these runs.
    measured
        (n, m) mean pressures of the 3D runs over their aortic pressure.
    lowest
        (p,) lower bounds of the standardised losses; their prior is standard normal.

    Returns
    -------
    LossFit
        Mode, covariance and residuals.
    """
    count = len(lowest)
    z, variance = np.zeros(count), FIRST_SD**2
    before = measured - model(z[None])[0]
    for _ in range(ITERATIONS):
        values = model(np.vstack([z, z + STEP * np.eye(count)]))
        slopes = np.moveaxis((values[1:] - values[0]) / STEP, 0, -1)  # (n, m, p)
        target = measured - values[0] + slopes @ z
        z, variance = _solve(slopes, target, lowest, variance)
    after = measured - model(z[None])[0]
    precision = _information(slopes) / variance + np.eye(count)
    left_out = np.empty_like(after)
    for run in range(len(measured)):
        others = np.arange(len(measured)) != run
        without, _ = _solve(slopes[others], target[others], lowest, variance)
        left_out[run] = after[run] + slopes[run] @ (z - without)
    return LossFit(z, np.linalg.inv(precision), before, after, left_out)


def _solve(slopes: np.ndarray, target: np.ndarray, lowest: np.ndarray, variance: float) -> tuple[np.ndarray, float]:
    """Return the mode of the linear model, and the noise's variance of largest evidence."""
    design, data = slopes.reshape(-1, len(lowest)), target.ravel()
    for _ in range(50):
        sd, former = np.sqrt(variance), variance
        rows = np.vstack([design / sd, np.eye(len(lowest))])
        z = lsq_linear(rows, np.concatenate([data / sd, np.zeros(len(lowest))]), (lowest, np.inf), "bvls").x
        information = _information(slopes) / variance
        determined = float(np.trace(np.linalg.solve(information + np.eye(len(lowest)), information)))
        left = float(np.sum((data - design @ z) ** 2))
        variance = left / max(len(data) - determined, 1.0)
        if abs(variance - former) < 1e-6 * former:
            break
    return z, variance


def _information(slopes: np.ndarray) -> np.ndarray:
    """Return the sum over runs and places of the products of slopes, (p, p)."""
    design = slopes.reshape(-1, slopes.shape[-1])
    return design.T @ design
