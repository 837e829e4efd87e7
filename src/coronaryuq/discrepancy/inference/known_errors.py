"""Errors that any prediction has: those of the time steps, and those of the vessels' own values."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.drawn_errors import described, left_by_others
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.time_step_error import FEW, FINER, FINEST, TimeSteps, time_steps, variation

OSCILLATES = 3.0
"""Difference between points in their time-step error, in noise standard deviations, from which on the model oscillates
in a way that the steps do not resolve, and that depends on the vessels' values nonlinearly."""
DRAWS = 32
"""Draws of the nuisance parameters and the vessels' errors then."""


@dataclass(frozen=True)
class KnownErrors:
    """Errors of time steps and vessels.

    steps: of the time steps, where the model oscillates together with what is not linear in the vessels' errors.
    weights, shapes, sd: of the linear effect of the vessels' errors, see `VesselErrors.shapes`.
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
    steps = (_of_both(runs, noise) if oscillates(runs, noise) else None) or time_steps(runs, noise)
    return KnownErrors(steps, *runs.vessels.shapes(np.hypot(noise, steps.sd)))


def oscillates(runs: ErrorRuns, noise: np.ndarray) -> bool:
    """Whether the model oscillates faster than its time steps resolve."""
    return variation(runs, noise) > OSCILLATES


def _of_both(runs: ErrorRuns, noise: np.ndarray) -> TimeSteps | None:
    """Compare short steps with the usual ones and linear vessels, at draws of the prior of everything.

    After each valve closure, blood moves between vessels that store it, with a frequency that their inertances and
    compliances set. An error of a few per cent shifts this oscillation against the data by as much as it is large, once
    ten periods have passed, and so do steps that do not resolve it. Returns None if the model runs at few draws.
    """
    random = generator(0, "discrepancy", "time steps and vessels")
    common = random.standard_normal((DRAWS, len(runs.forward.nuisances)))
    errors = random.standard_normal((DRAWS, len(runs.vessels.errors)))
    both = np.hstack([common, errors])
    # In a closed loop, the finer runs start from the states of these.
    runs.predicted(both, 1, vessels=True)
    fine = runs.predicted(both, FINER, vessels=True)
    change = (fine - runs.predicted(common, 1) - errors @ runs.vessels.changes) / noise
    further = (runs.predicted(both[: 2 * FEW], FINEST, vessels=True) - fine[: 2 * FEW]) / noise
    change, further = (some[np.isfinite(some).all(axis=1)] for some in (change, further))
    if len(change) < DRAWS // 2 or not len(further):
        return None
    mean = change.mean(axis=0)
    shapes, sd = described(runs.forward, (change - mean, further), left_by_others(change))
    return TimeSteps(noise * mean, noise * shapes, noise * sd)
