"""Errors that any prediction has: those of the time steps, and those of the vessels' own values."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.time_step_error import TimeSteps, time_steps, variation

OSCILLATES = 3.0
"""Difference between points in their time-step error, in noise standard deviations, from which on the model oscillates
in a way that the steps do not resolve, and that depends on the vessels' values nonlinearly."""


@dataclass(frozen=True)
class KnownErrors:
    """Errors of time steps and vessels.

    steps: of the time steps. weights, shapes, sd: of the vessels whose values are no parameters of the model, see
    `VesselErrors.shapes`.
    """

    steps: TimeSteps
    weights: list[Nuisance]
    shapes: np.ndarray
    sd: np.ndarray


def known_errors(runs: ErrorRuns, noise: np.ndarray) -> KnownErrors:
    """Estimate the errors of time steps and vessels.

    Parameters
    ----------
    runs
        Runs of the model.
    noise
        Standard deviations of the data: (N,), CGS.

    Returns
    -------
    KnownErrors
        Shapes and remaining standard deviations.
    """
    steps = time_steps(runs, noise)
    return KnownErrors(steps, *runs.vessels.shapes(np.hypot(noise, steps.sd)))


def oscillates(runs: ErrorRuns, noise: np.ndarray) -> bool:
    """Whether the model oscillates faster than its time steps resolve."""
    return variation(runs, noise) > OSCILLATES


def with_vessels(runs: ErrorRuns, noise: np.ndarray) -> ErrorRuns:
    """Return the runs of the model with the vessels' own values among its parameters, where it oscillates.

    After each valve closure, blood moves between vessels that store it, with a frequency that their inertances and
    compliances set. An error of a few per cent shifts this oscillation against the data by as much as it is large, once
    ten periods have passed: its effect is not linear.
    """
    return runs.with_vessels(noise) if oscillates(runs, noise) else runs
