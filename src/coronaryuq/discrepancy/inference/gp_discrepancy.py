"""Flexible discrepancy: a Gaussian process that stands for any missing effect, the reference for named ones.

A Gaussian process over place, phase and condition (Kennedy & O'Hagan 2001), written as a linear model in its features:
for each measured place and quantity a constant and Fourier waves of the cycle (of a pullback: of twice its path, which
need not be equal at both ends) with variance falling as (1 + h^2)^-2,
half of the variance common to all conditions, half specific to each condition; its amplitude is a fraction of the
series' size in the fitted conditions (`flexible`).
"""

from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.core.harmonics import fourier_basis
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.flexible import Flexible

if TYPE_CHECKING:
    from coronaryuq.discrepancy.inference.problem import Problem

HARMONICS = 8


def phase_of(series: Measured) -> np.ndarray | None:
    """Return the phases (k,) of a waveform in the cycle, or of a pullback in twice its path; None for single values."""
    if series.time is not None:
        return (series.time / series.period) % 1.0
    if series.pullback is not None and series.value.size > 1:
        return 0.5 * series.pullback.distance / series.pullback.length
    return None


def features(problem: "Problem", common: bool = False) -> np.ndarray:
    """Return features (N, k) of unit amplitude, whitened, of all data; their weights are standard normal a priori.

    Parameters
    ----------
    problem
        Measurements.
    common
        Whether all places of a quantity share one process, each as a fraction of its size (waveforms one, pullbacks
        another); otherwise each place has its own.

    Returns
    -------
    ndarray
        (N, k).
    """
    forward = problem.forward
    each = [(s.quantity, s.location, s.statistic) for s in forward.measured]
    conditions = list(dict.fromkeys(s.condition for s in forward.measured))
    size: dict[tuple, float] = {}
    # Held-out values do not determine the amplitude unless nothing else was measured.
    for held_out in (False, True):
        known = set(size)
        for key, series in zip(each, forward.measured, strict=True):
            if forward.conditions[series.condition].held_out is held_out and key not in known:
                size[key] = max(size.get(key, 0.0), float(np.abs(series.value).max()))
    waves = 2 * HARMONICS + 1
    processes = [(s.quantity, s.time is None) for s in forward.measured] if common else each
    distinct = list(dict.fromkeys(processes))
    blocks = np.zeros((len(problem.y), len(distinct), len(conditions) + 1, waves))
    for key, process, series, rows in zip(each, processes, forward.measured, forward.rows, strict=True):
        columns = np.zeros((series.value.size, waves))
        columns[:, 0] = 1.0
        phase = phase_of(series)
        if phase is not None:
            columns = fourier_basis(phase, HARMONICS) / (1.0 + np.r_[0 : HARMONICS + 1, 1 : HARMONICS + 1] ** 2)
        scaled = columns * size[key] / problem.sd[rows, None] * np.sqrt(0.5)
        for part in (0, 1 + conditions.index(series.condition)):
            blocks[rows, distinct.index(process), part] = scaled
    matrix = blocks.reshape(len(problem.y), -1)
    return matrix[:, np.abs(matrix).max(axis=0) > 0]


def blocks(problem: "Problem") -> np.ndarray:
    """Return the number of the independent block of each row (N,): its measured place and quantity."""
    each = [(s.quantity, s.location, s.statistic) for s in problem.forward.measured]
    keys = list(dict.fromkeys(each))
    return np.array([keys.index(key) for key in each])[problem.owner]


def flexible(problem: "Problem", rows: np.ndarray) -> Flexible:
    """Return the flexible discrepancy of some rows (N,), bool."""
    columns, shapes = problem.shape_weights()
    known = columns, shapes[rows]
    return Flexible(features(problem)[rows], blocks(problem)[rows], known, problem.widened[rows].sum())
