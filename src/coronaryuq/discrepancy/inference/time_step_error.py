"""Time-step error: the change of predictions by the time steps, and its uncertainty."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.few_draws import left_by_others, principal
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.vessel_errors import SHAPED

FINER, FINEST = 8, 32
"""Refinements of the time steps for the comparison, and those used if points differ."""
DRAWS, MORE, FEW, SPREAD = 16, 32, 2, 0.5
"""Number of points at which steps are compared (the plain model, and draws of the nuisance parameters with standard
deviation `SPREAD`); number in all, and with the finest steps, if the change differs between points."""
OSCILLATES = 3.0
"""Difference between points in their time-step error, in noise standard deviations, from which on the model oscillates
in a way that the steps do not resolve, and that depends on the vessels' values nonlinearly."""
OWN = 3
"""Maximum number of further shapes per series, for its part that common shapes do not describe."""

Sized = tuple[Hypothesis, np.ndarray]
"""Effects, and their sizes in standard deviations."""


@dataclass(frozen=True)
class TimeSteps:
    """Change of predictions by steps `FINER` times as short, CGS.

    change: mean (N,); shapes: largest differences between points, of all rows and then of single series, (k, N), with
    standard normal weights; sd: standard deviation of the rest (N,), independent between rows. about: where short steps
    at a fit do not tell the change there, the effects on the network with which it was drawn.
    """

    change: np.ndarray
    shapes: np.ndarray
    sd: np.ndarray
    about: Sized | None = None


def oscillates(runs: ErrorRuns, noise: np.ndarray) -> bool:
    """Whether the model oscillates faster than its time steps resolve."""
    change = _finite(runs.change(_points(runs)[:DRAWS], 1, FINER)) / noise
    return bool(len(change)) and float(principal(change - change.mean(axis=0))[0].max()) > OSCILLATES


def time_steps(runs: ErrorRuns, noise: np.ndarray) -> TimeSteps:
    """Estimate the time-step error by comparing steps at points of the prior.

    Valves open and close between two steps, and vessels that store blood then oscillate: the time-step error there is
    no misfit of the model. The part common to all points is corrected. The rest is not independent noise of each row
    but has few shapes, perhaps those of an effect, such as a valve that damps the oscillation: these get weights, as do
    the shapes of the change by still shorter steps. Of what remains at other points, the worst shapes of each series
    also get weights, and each row gets the root mean square along the worst remaining shape as noise. If the change is
    the same at all points, the error of the shorter steps is, to first order, the same fraction of it as their length.

    Parameters
    ----------
    runs
        Runs of the model.
    noise
        Standard deviations of the data: (N,), CGS.

    Returns
    -------
    TimeSteps
        Correction, shapes and remaining standard deviations.
    """
    forward, points = runs.forward, _points(runs)
    change = _finite(runs.change(points[:DRAWS], 1, FINER)) / noise
    if len(change) < 3:
        # If the model runs at few points, only the size of the change is known.
        return TimeSteps(np.zeros(forward.size), np.zeros((0, forward.size)), noise * np.abs(change).sum(axis=0))
    further, left = change.mean(axis=0)[None, :] / FINER, np.zeros((0, forward.size))
    differs = principal(change - change.mean(axis=0))[0].max() > SHAPED
    if differs:
        change = np.vstack([change, _finite(runs.change(points[DRAWS:], 1, FINER)) / noise])
        finest = _finite(runs.change(points[:FEW], FINER, FINEST)) / noise
        further = finest if len(finest) == FEW else further
        left = left_by_others(change)
    mean = change.mean(axis=0)
    shapes, sd = _shapes(forward, [change - mean, further], left, differs)
    return TimeSteps(noise * mean, noise * shapes, noise * sd)


def _points(runs: ErrorRuns) -> np.ndarray:
    """Return the points (`MORE`, p), of which the first is the plain model."""
    points = SPREAD * generator(0, "discrepancy", "time steps").standard_normal((MORE, len(runs.forward.nuisances)))
    points[0] = 0.0
    return points


def _finite(rows: np.ndarray) -> np.ndarray:
    """Return the rows of (n, N) at whose points the model ran."""
    return rows[np.isfinite(rows).all(axis=1)]


def _shapes(forward: Forward, sets: list[np.ndarray], left: np.ndarray, shaped: bool) -> tuple[np.ndarray, np.ndarray]:
    """Describe sets of deviations (n, N), in noise standard deviations, by shapes, and by noise for the rest.

    Principal components longer than `SHAPED` get weights, if `shaped`. Of what they leave, and of `left` (m, N), see
    `left_by_others`, the worst shapes of each series also get weights, and each row gets the root mean square along
    the worst remaining shape as noise, (N,).
    """
    lengths, shapes = (np.concatenate(each) for each in zip(*map(principal, sets), strict=True))
    long = (lengths > SHAPED) & shaped
    own, sd = _each_series(forward, np.vstack([left, shapes[~long]]), OWN * shaped)
    return np.vstack([shapes[long], own]), sd


def _each_series(forward: Forward, rest: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the worst shapes (k, N) of each series in (n, N), and standard deviations (N,) that cover the others."""
    own, sd = [], np.zeros(forward.size)
    for rows in forward.rows:
        lengths, shapes = principal(rest[:, rows] * np.sqrt(len(rest)))
        count = min(most, int((lengths > SHAPED).sum()), len(lengths) - 1)
        own.append(np.zeros((count, forward.size)))
        own[-1][:, rows] = shapes[:count]
        sd[rows] = lengths[count]
    return np.vstack(own), sd
