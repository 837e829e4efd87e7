"""Errors that any prediction has: those of the time steps, and those of the vessels' own values."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.drawn_errors import described, left_by_others
from coronaryuq.discrepancy.inference.time_step_error import FEW, FINER, FINEST, TimeSteps, finer, time_steps
from coronaryuq.discrepancy.inference.vessel_errors import VesselErrors, vessel_errors

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


def known_errors(forward: Forward, noise: np.ndarray) -> KnownErrors:
    """Estimate the errors of time steps and vessels.

    Parameters
    ----------
    forward
        The model.
    noise
        Standard deviations of the data: (N,), CGS.

    Returns
    -------
    KnownErrors
        Shapes and remaining standard deviations.
    """
    steps, vessels = time_steps(forward, noise), vessel_errors(forward)
    if oscillates(steps):
        steps = _of_both(forward, noise, vessels) or steps
    return KnownErrors(steps, *vessels.shapes(np.hypot(noise, steps.sd)))


def oscillates(steps: TimeSteps) -> bool:
    """Whether the model oscillates faster than its time steps resolve."""
    return steps.varies > OSCILLATES


def _of_both(forward: Forward, noise: np.ndarray, vessels: VesselErrors) -> TimeSteps | None:
    """Compare short steps with the usual ones and linear vessels, at draws of the prior of everything.

    After each valve closure, blood moves between vessels that store it, with a frequency that their inertances and
    compliances set. An error of a few per cent shifts this oscillation against the data by as much as it is large, once
    ten periods have passed, and so do steps that do not resolve it. Returns None if the model runs at few draws.
    """
    random = generator(0, "discrepancy", "time steps and vessels")
    common = random.standard_normal((DRAWS, len(forward.nuisances)))
    errors = random.standard_normal((DRAWS, len(vessels.errors)))
    both = np.hstack([common, errors])
    fine = finer(vessels.model, FINER).predict(both)
    change = (fine - forward.predict(common) - errors @ vessels.changes) / noise
    further = (finer(vessels.model, FINEST).predict(both[: 2 * FEW]) - fine[: 2 * FEW]) / noise
    change, further = (some[np.isfinite(some).all(axis=1)] for some in (change, further))
    if len(change) < DRAWS // 2 or not len(further):
        return None
    mean = change.mean(axis=0)
    shapes, sd = described(forward, (change - mean, further), left_by_others(change))
    return TimeSteps(noise * mean, noise * shapes, noise * sd)
