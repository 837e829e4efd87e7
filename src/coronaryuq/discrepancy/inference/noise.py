"""What waveforms say of their noise themselves: how large it is, and how long it lasts.

With standard deviations that are too small, or noise that lasts from one sample to the next, every law looks wrong:
what comes nearest does not foretell what was kept out, and nothing is named. Noise is told from what a model lacks by
what it does beyond the first harmonics of the cycle.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import phases

HARMONICS = 6
"""Harmonics of the cycle, at most, that are taken out of each waveform before it counts as scatter."""
TRIMMED = 0.1
"""Share of the largest squares left out: valves that shut a sample too late are no noise."""
LARGER, SMALLER = (1.2, 1e-4), (0.92, 0.01)
"""Factors on the standard deviations between which noise is taken to be as it is said to be, and chances of such a
scatter above which too. A search stands with other noise where held-out measurements bear it out; what comes and goes
within the cycle looks like larger noise, but nothing like one that lasts.
"""
LONGEST = 10.0
"""Longest time that noise may last, in cycles; the shortest is a thousandth of that between two samples."""
SMOOTH = 2.0
"""Variance of a shape of lasting noise, over that of the white rest, from which it has a weight of its own."""

_BOUND = float(stats.chi2.ppf(1.0 - TRIMMED, 1))
_MEAN = float(stats.chi2.cdf(_BOUND, 3)) / (1.0 - TRIMMED)
"""Mean of the smaller squares of standard normal numbers."""
_CLIPPED = float(stats.chi2.cdf(_BOUND, 3)) + TRIMMED * _BOUND
_SPREAD = np.sqrt(3.0 * float(stats.chi2.cdf(_BOUND, 5)) + TRIMMED * _BOUND**2 - _CLIPPED**2) / (1.0 - TRIMMED) / _MEAN
"""Standard deviation, times the root of their number, of such a mean over its expectation (Huber & Ronchetti 2009)."""


@dataclass(frozen=True)
class Noise:
    """Noise of one quantity's waveforms. scatter: from sample to sample, over the standard deviation that is said;
    lasting: s in which it falls to 1/e, where its standard deviation is as said; 0: white, and as large as it scatters.
    """

    scatter: float
    lasting: float = 0.0


def told(noise: dict[str, Noise]) -> str:
    """The noise of several quantities in words."""
    said = []
    for quantity, one in noise.items():
        lasting = f", lasting {one.lasting:.2g} s" if one.lasting else ""
        said.append(f"{quantity} {one.scatter:.2f} times{lasting}")
    return "; ".join(said)


@dataclass(frozen=True)
class Scatter:
    """Of one quantity's waveforms beyond the first harmonics: all of them together over the said standard deviation,
    chances that the middle one scatters as much, and as little.
    """

    factor: float
    p_larger: float
    p_smaller: float


def estimated_noise(problem: Problem, fit: Fit) -> dict[str, Noise]:
    """By quantity, the noise of waveforms that scatter more than their standard deviations say, or less.

    Of noise that scatters less, that which lasts is the part that is not seen: its standard deviation is the one that
    is said, its correlation exp(-|t| / lasting) (Ornstein-Uhlenbeck), which is what leaves that scatter.
    """
    found = {}
    for quantity, one in scatter(problem, fit).items():
        if one.factor > LARGER[0] and one.p_larger < LARGER[1]:
            found[quantity] = Noise(one.factor)
        elif one.factor < SMALLER[0] and one.p_smaller < SMALLER[1]:
            found[quantity] = Noise(one.factor, _lasting(problem, quantity, one.factor))
    return found


def scatter(problem: Problem, fit: Fit) -> dict[str, Scatter]:
    """By quantity, of the fitted waveforms about a fit; standard deviations are taken with the model's floor and what
    time steps add.

    Of each residual waveform (k samples) the mean and the first harmonics, as many as leave half of the samples, are
    projected out, and each sample is divided by the share of its standard deviation that this leaves. Chances are those
    of the median of the waveforms: what a model lacks is in some of them, noise in all.
    """
    found: dict[str, list[tuple[np.ndarray, int]]] = {}
    for series, rows, phase in _waveforms(problem):
        left, kept, freedom = _beyond(phase)
        squares = (left @ fit.residual[rows])[kept > 0.0] ** 2 / kept[kept > 0.0]
        found.setdefault(series.quantity, []).append((squares, freedom))
    return {quantity: _scatter(*zip(*of, strict=True)) for quantity, of in found.items()}


def _waveforms(problem: Problem):
    """Each fitted waveform with the positions of its samples among the fitted rows, and their phases."""
    for number, rows, phase in phases(problem, problem.train):
        if phase is not None:
            yield problem.forward.measured[number], rows, phase


def _beyond(phase: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Projection (k, k) on what the first harmonics cannot follow, the share of each sample's variance that it leaves
    (0: none), and its rank.
    """
    count = min(HARMONICS, (phase.size // 2 - 1) // 2)
    angles = 2.0 * np.pi * np.outer(phase, np.arange(1, count + 1))
    basis, _ = np.linalg.qr(np.hstack([np.ones((phase.size, 1)), np.cos(angles), np.sin(angles)]))
    left = np.eye(phase.size) - basis @ basis.T
    kept = np.diag(left)
    return left, np.where(kept > 1e-6, kept, 0.0), phase.size - basis.shape[1]


def _scatter(squares: tuple[np.ndarray, ...], freedom: tuple[int, ...]) -> Scatter:
    """Of the squares of waveforms, each of so many degrees of freedom."""
    middle = float(np.median([_share(one) for one in squares]))
    # Of one or two the median is the mean, of more it varies more.
    spread = _SPREAD / np.sqrt(sum(freedom)) * (np.sqrt(np.pi / 2.0) if len(squares) > 2 else 1.0)
    z = (middle - 1.0) / spread
    factor = float(np.sqrt(_share(np.concatenate(squares))))
    return Scatter(factor, float(stats.norm.sf(z)), float(stats.norm.cdf(z)))


def _share(squares: np.ndarray) -> float:
    """Mean square with the largest left out, over that of standard normal numbers."""
    return float(np.sort(squares)[: int(np.ceil((1.0 - TRIMMED) * squares.size))].mean()) / _MEAN


def _lasting(problem: Problem, quantity: str, factor: float) -> float:
    """Time (s) that noise lasts which scatters by that factor on its standard deviation."""
    mine = [(series, *_beyond(phase)) for series, _, phase in _waveforms(problem) if series.quantity == quantity]

    def excess(logarithm: float) -> float:
        shares = []
        for series, left, kept, _ in mine:
            within = np.diag(left @ _correlation(series, np.exp(logarithm)) @ left)
            shares.append(within[kept > 0.0] / kept[kept > 0.0])
        return float(np.concatenate(shares).mean()) - factor**2

    shortest = 1e-3 * min(np.diff(series.time).min() for series, *_ in mine)
    longest = LONGEST * max(series.period for series, *_ in _waveforms(problem))
    if excess(np.log(longest)) > 0.0:
        return longest
    return float(np.exp(brentq(excess, np.log(shortest), np.log(longest), xtol=1e-6)))


def _correlation(series: Measured, lasting: float) -> np.ndarray:
    """(k, k) between samples, the shorter way round the beat: where a beat is cut makes no difference."""
    apart = np.abs(series.time[:, None] - series.time[None, :]) % series.period
    return np.exp(-np.minimum(apart, series.period - apart) / lasting)


def parts(series: Measured, noise: Noise) -> tuple[float, np.ndarray]:
    """What noise of unit standard deviation is made of in one waveform (k samples): standard deviation of the white
    part, and shapes (n, k) with standard normal weights.
    """
    if noise.lasting == 0.0:
        return noise.scatter, np.zeros((0, series.value.size))
    variances, shapes = np.linalg.eigh(_correlation(series, noise.lasting))
    variances, shapes = variances[::-1], shapes.T[::-1]
    rest = np.cumsum(variances[::-1])[::-1] / np.arange(variances.size, 0, -1)
    count = int(np.argmax(variances < SMOOTH * rest))
    white = rest[count]
    return float(np.sqrt(white)), shapes[:count] * np.sqrt(variances[:count] - white)[:, None]


def with_lasting(problem: Problem) -> np.ndarray:
    """Standard deviations (N,) of the measurements, with those of noise that lasts."""
    lasting = [nuisance.shape for nuisance in problem.forward.nuisances if nuisance.noise]
    shapes = problem.forward.shapes[lasting] if lasting else np.zeros((0, problem.sd.size))
    return np.sqrt(problem.sd**2 + np.sum(shapes**2, axis=0))
