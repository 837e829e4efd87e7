"""Errors that any prediction has: those of the time steps, and those of the vessels' own values."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.unresolved import sampled
from coronaryuq.discrepancy.inference.drawn_errors import described, left_by_others
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.time_step_error import FINER, TimeSteps, time_steps, variation

OSCILLATES = 3.0
"""Difference between points in their time-step error, in noise standard deviations, from which on the model oscillates
in a way that the steps do not resolve, and that depends on the vessels' values nonlinearly."""
DRAWS = 48
"""Draws of the nuisance parameters and of the vessels' errors then."""


@dataclass(frozen=True)
class KnownErrors:
    """Errors of time steps and vessels.

    steps: of the time steps, where the model oscillates together with those of the vessels.
    weights, shapes, sd: of the vessels, where their effect is linear, see `VesselErrors.shapes`.
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
    steps = _unresolved(runs, noise) if oscillates(runs, noise) else None
    if steps is not None:
        return KnownErrors(steps, [], np.zeros((0, len(noise))), np.zeros(len(noise)))
    steps = time_steps(runs, noise)
    return KnownErrors(steps, *runs.vessels.shapes(np.hypot(noise, steps.sd)))


def oscillates(runs: ErrorRuns, noise: np.ndarray) -> bool:
    """Whether the model oscillates faster than its time steps resolve."""
    return variation(runs, noise) > OSCILLATES


def _unresolved(runs: ErrorRuns, noise: np.ndarray) -> TimeSteps | None:
    """Compare short steps and other vessels with the model, at draws of the prior of everything.

    After each valve closure, blood moves between vessels that store it, with a frequency that their inertances and
    compliances set. An error of a few per cent shifts this oscillation against the data by as much as it is large, once
    ten periods have passed, and so do steps that do not resolve it: its phase is unknown, and short steps at a fit do
    not give it. Returns None if the model runs at few draws.
    """
    random, forward = generator(0, "discrepancy", "time steps and vessels"), runs.forward
    common = random.standard_normal((DRAWS, len(forward.nuisances)))
    both = np.hstack([common, random.standard_normal((DRAWS, len(runs.vessels.errors)))])
    # Short steps start from the states of the usual ones.
    usual, _ = runs.waveforms(common, 1), runs.with_vessels.waveforms(both, 1)
    short = runs.with_vessels.waveforms(both, FINER)
    change = sampled(forward, short, common) - sampled(forward, usual, common)
    ran = np.isfinite(change).all(axis=1)
    if ran.sum() < DRAWS // 2:
        return None
    waves = {
        condition: {name: _mean_and_shapes((short[condition][name] - wave)[ran]) for name, wave in own.items()}
        for condition, own in usual.items()
    }
    mean, *shapes = _mean_and_shapes(change[ran])
    of_series, sd = described(forward, (), left_by_others(change[ran] / noise))
    return TimeSteps(mean, np.vstack([shapes, noise * of_series]), noise * sd, waves)


def _mean_and_shapes(draws: np.ndarray) -> np.ndarray:
    """Return the mean of draws (n, N), and shapes whose standard normal weights give their covariance: (1 + n, N)."""
    mean = draws.mean(axis=0)
    return np.vstack([mean, (draws - mean) / np.sqrt(len(draws) - 1)])
