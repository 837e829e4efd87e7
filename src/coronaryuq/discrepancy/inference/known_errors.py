"""Errors that any prediction has: those of the time steps, of the vessels' own values, and of vessels as lumps."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.core.shrinkage import fresh_draw
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.forward.instruments import Instruments
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.unresolved import sampled
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.time_step_error import FINER, Sized, TimeSteps, oscillates, time_steps
from coronaryuq.discrepancy.inference.vessel_errors import VesselErrors

DRAWS = 128
"""Number of draws of the nuisance parameters and of the vessels' errors, where the model oscillates."""


@dataclass(frozen=True)
class KnownErrors:
    """Errors of time steps and vessels.

    steps: of the time steps, where the model oscillates together with those of the vessels.
    parameters: of the vessels, where their effect is not linear. weights, shapes, sd: where it is, see
    `VesselErrors.shapes`.
    """

    steps: TimeSteps
    parameters: VesselErrors
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
    steps = unresolved(runs, noise, (PLAIN, np.zeros(0)), []) if oscillates(runs, noise) else None
    if steps is not None:
        none = np.zeros((0, len(noise)))
        return KnownErrors(steps, VesselErrors([], none, none), [], none, np.zeros(len(noise)))
    steps = time_steps(runs, noise)
    noise = np.hypot(noise, steps.sd)
    linear, others = runs.vessels.divided(noise)
    return KnownErrors(steps, others, *linear.with_(runs.lumping).shapes(noise))


def unresolved(runs: ErrorRuns, noise: np.ndarray, about: Sized, chain: Instruments) -> TimeSteps | None:
    """Compare short steps and other vessels with the model, at draws of the prior of everything.

    After each valve closure, blood moves between vessels that store it, with a frequency that their inertances and
    compliances set. An error of a few per cent shifts this oscillation against the data by as much as it is large, once
    ten periods have passed, and so do steps that do not resolve it: its phase is unknown, and short steps at a fit do
    not give it.

    Parameters
    ----------
    runs, noise
        As for `known_errors`.
    about
        Effects on the network, which may change the oscillation.
    chain
        Instruments, which read it as they read the rest of a waveform.

    Returns
    -------
    TimeSteps or None
        Always with `DRAWS` shapes, of which the last may be zero; None if the model runs at few draws.
    """
    random, forward = generator(0, "discrepancy", "time steps and vessels"), runs.forward
    common, same = random.standard_normal((DRAWS, len(forward.nuisances))), np.tile(about[1], (DRAWS, 1))
    both = np.hstack([common, random.standard_normal((DRAWS, len(runs.vessels.errors))), same])
    common, effects = np.hstack([common, same]), about[0]
    # Short steps start from the states of the usual ones.
    usual, _ = runs.waveforms(common, 1, effects), runs.with_vessels.waveforms(both, 1, effects)
    short = runs.with_vessels.waveforms(both, FINER, effects)
    change = np.subtract(*(sampled(forward, waves, common, effects, chain) for waves in (short, usual)))
    change = change[np.isfinite(change).all(axis=1)]
    if len(change) < DRAWS // 2:
        return None
    mean, shapes, sd = fresh_draw(change / noise)
    missing = np.zeros((DRAWS - len(change), forward.size))
    return TimeSteps(noise * mean, noise * np.vstack([shapes, missing]), noise * sd, about)
