"""Noise of waveforms, estimated from their scatter: its size, and its correlation time.

With standard deviations that are too small, or noise correlated in time, every hypothesis looks wrong: the best one
does not predict the held-out data, and nothing is named. Noise is distinguished from missing effects by its part beyond
the first harmonics of the cycle.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import phases

HARMONICS = 6
"""Maximum number of harmonics of the cycle that are removed from each waveform; the rest is scatter."""
TRIMMED = 0.1
"""Fraction of the largest squares left out: a valve that closes one sample late is not noise."""
LONGEST = 10.0
"""Longest correlation time, in cycles; the shortest is a thousandth of the sampling interval."""
SMOOTH = 2.0
"""Variance of a shape of correlated noise, over that of the white remainder, above which it gets a separate weight."""

_BOUND = float(stats.chi2.ppf(1.0 - TRIMMED, 1))
_MEAN = float(stats.chi2.cdf(_BOUND, 3)) / (1.0 - TRIMMED)
"""Mean of the smaller squares of standard normal numbers."""
_CLIPPED = float(stats.chi2.cdf(_BOUND, 3)) + TRIMMED * _BOUND
_SPREAD = np.sqrt(3.0 * float(stats.chi2.cdf(_BOUND, 5)) + TRIMMED * _BOUND**2 - _CLIPPED**2) / (1.0 - TRIMMED) / _MEAN
"""Standard deviation, times the root of their number, of such a mean over its expectation (Huber & Ronchetti 2009)."""


@dataclass(frozen=True)
class Noise:
    """Noise of the waveforms of one quantity.

    scatter: from sample to sample, over the stated standard deviation; correlation_time: correlation time (s), with the
    stated standard deviation; 0: white noise as large as its scatter.
    """

    scatter: float
    correlation_time: float = 0.0


def noise_text(noise: dict[str, Noise]) -> str:
    """Return the noise of several quantities in words."""
    parts = []
    for quantity, entry in noise.items():
        correlated = f", correlated over {entry.correlation_time:.2g} s" if entry.correlation_time else ""
        parts.append(f"{quantity} {entry.scatter:.2f} times{correlated}")
    return "; ".join(parts)


@dataclass(frozen=True)
class Scatter:
    """Scatter of the waveforms of one quantity beyond the first harmonics.

    factor: of all together, over the stated standard deviation; p_larger, p_smaller: of the median waveform.
    """

    factor: float
    p_larger: float
    p_smaller: float


def estimated_noise(problem: Problem, fit: Fit) -> dict[str, Noise]:
    """Return the noise of quantities whose waveforms scatter more than their standard deviations, or less.

    Noise that scatters less is correlated: it has the stated standard deviation and the correlation exp(-|t| /
    correlation_time) (Ornstein-Uhlenbeck) that leaves this scatter.
    """
    noise = {}
    for quantity, seen in scatter(problem, fit).items():
        if seen.factor > RULE.larger_noise and seen.p_larger < RULE.larger_noise_p:
            noise[quantity] = Noise(seen.factor)
        elif seen.factor < RULE.smaller_noise and seen.p_smaller < RULE.smaller_noise_p:
            noise[quantity] = Noise(seen.factor, _correlation_time(problem, quantity, seen.factor))
    return noise


def scatter(problem: Problem, fit: Fit) -> dict[str, Scatter]:
    """Return the scatter of the fitted waveforms about a fit, by quantity.

    Over standard deviations with the model's floor and the time-step allowance. Mean and first harmonics of each
    residual waveform, as many as leave half of the samples, are projected out, and each sample is divided by the
    fraction of its standard deviation that remains. p-values are those of the median waveform: missing effects are in
    some waveforms, noise in all.
    """
    squares_of: dict[str, list[tuple[np.ndarray, int]]] = {}
    for series, rows, phase in _waveforms(problem):
        left, kept, freedom = _beyond(phase)
        squares = (left @ fit.residual[rows])[kept > 0.0] ** 2 / kept[kept > 0.0]
        squares_of.setdefault(series.quantity, []).append((squares, freedom))
    return {quantity: _scatter(*zip(*parts, strict=True)) for quantity, parts in squares_of.items()}


def _waveforms(problem: Problem) -> Iterator[tuple[Measured, np.ndarray, np.ndarray]]:
    """Yield each fitted waveform, positions of its samples among the fitted rows, and their phases."""
    for number, rows, phase in phases(problem, problem.train):
        if phase is not None:
            yield problem.forward.measured[number], rows, phase


def _beyond(phase: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the projection (k, k) that removes the first harmonics, and its rank; between them the variance left.

    The variance left is a fraction (k,) of each sample's variance, 0 if negligible.
    """
    count = min(HARMONICS, (phase.size // 2 - 1) // 2)
    angles = 2.0 * np.pi * np.outer(phase, np.arange(1, count + 1))
    basis, _ = np.linalg.qr(np.hstack([np.ones((phase.size, 1)), np.cos(angles), np.sin(angles)]))
    left = np.eye(phase.size) - basis @ basis.T
    kept = np.diag(left)
    return left, np.where(kept > 1e-6, kept, 0.0), phase.size - basis.shape[1]


def _scatter(squares: tuple[np.ndarray, ...], freedom: tuple[int, ...]) -> Scatter:
    """Return the scatter from the squares of waveforms and the degrees of freedom of each."""
    middle = float(np.median([_share(part) for part in squares]))
    # The median of one or two values is their mean; that of more values varies more than the mean.
    spread = _SPREAD / np.sqrt(sum(freedom)) * (np.sqrt(np.pi / 2.0) if len(squares) > 2 else 1.0)
    z = (middle - 1.0) / spread
    factor = float(np.sqrt(_share(np.concatenate(squares))))
    return Scatter(factor, float(stats.norm.sf(z)), float(stats.norm.cdf(z)))


def _share(squares: np.ndarray) -> float:
    """Return the mean square without the largest, over that of standard normal numbers."""
    return float(np.sort(squares)[: int(np.ceil((1.0 - TRIMMED) * squares.size))].mean()) / _MEAN


def _correlation_time(problem: Problem, quantity: str, factor: float) -> float:
    """Return the correlation time (s) of noise that scatters by a factor on its standard deviation."""
    own = [(series, *_beyond(phase)) for series, _, phase in _waveforms(problem) if series.quantity == quantity]

    def excess(logarithm: float) -> float:
        shares = []
        for series, left, kept, _ in own:
            within = np.diag(left @ _correlation(series, np.exp(logarithm)) @ left)
            shares.append(within[kept > 0.0] / kept[kept > 0.0])
        return float(np.concatenate(shares).mean()) - factor**2

    shortest = 1e-3 * min(np.diff(_time(series)).min() for series, *_ in own)
    longest = LONGEST * max(series.period for series, *_ in _waveforms(problem))
    if excess(np.log(longest)) > 0.0:
        return longest
    return float(np.exp(brentq(excess, np.log(shortest), np.log(longest), xtol=1e-6)))


def _time(series: Measured) -> np.ndarray:
    if series.time is None:
        raise ValueError(f"{series.quantity} at {series.location} is not a waveform")
    return series.time


def _correlation(series: Measured, correlation_time: float) -> np.ndarray:
    """Return correlations (k, k) of samples by their distance around the beat, whose starting point is irrelevant."""
    time = _time(series)
    apart = np.abs(time[:, None] - time[None, :]) % series.period
    return np.exp(-np.minimum(apart, series.period - apart) / correlation_time)


def white_and_correlated(series: Measured, noise: Noise) -> tuple[float, np.ndarray]:
    """Decompose noise of unit standard deviation in one waveform (k samples).

    Returns the standard deviation of its white part, and shapes (n, k) with standard normal weights.
    """
    if noise.correlation_time == 0.0:
        return noise.scatter, np.zeros((0, series.value.size))
    variances, shapes = np.linalg.eigh(_correlation(series, noise.correlation_time))
    variances, shapes = variances[::-1], shapes.T[::-1]
    rest = np.cumsum(variances[::-1])[::-1] / np.arange(variances.size, 0, -1)
    count = int(np.argmax(variances < SMOOTH * rest))
    white = rest[count]
    return float(np.sqrt(white)), shapes[:count] * np.sqrt(variances[:count] - white)[:, None]


def with_correlated(problem: Problem) -> np.ndarray:
    """Return the standard deviations (N,) of the measurements, including correlated noise."""
    rows = [n.shape for n in problem.forward.nuisances if n.noise and n.shape is not None]
    all_shapes = problem.forward.shapes
    shapes = np.zeros((0, problem.sd.size)) if all_shapes is None or not rows else all_shapes[rows]
    return np.sqrt(problem.sd**2 + np.sum(shapes**2, axis=0))
