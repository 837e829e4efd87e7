"""Noise of waveforms, estimated from their scatter: its size, and its correlation time.

With standard deviations that are too small, or noise correlated in time, every hypothesis looks wrong: the best one
does not predict the held-out data, and nothing is named. Noise is distinguished from missing effects by its part beyond
the first harmonics of the cycle.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from coronaryuq.core.chi_squared import trimmed_mean_square
from coronaryuq.core.correlated_noise import around_the_beat, white_and_shapes
from coronaryuq.core.harmonics import fourier_basis
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.residual_tests import phases

HARMONICS = 3
"""Maximum number of harmonics of the cycle that are removed from each waveform; the rest is scatter."""
TRIMMED = 0.1
"""Fraction of the largest squares left out: a valve that closes one sample late is not noise."""
CORRELATIONS, OF_DENSE_SAMPLES = (0.2, 0.35, 0.5, 0.6, 0.7, 0.8), (0.87, 0.92, 0.95, 0.97)
"""Correlations of successive samples that are compared with none; the latter only of dense samples (`LONGEST`)."""
LONGEST = 0.1
"""Longest correlation time of dense samples, over the beat; noise that lasts longer is an offset or a drift."""
AS_STATED, OTHER, CORRELATED = 0.6, 0.2, 0.2
"""Prior probabilities of noise as stated, of another scale, and correlated."""
OF_VALUES = {1.0: AS_STATED, 1.5: 0.24, 2.25: 0.16}
"""Possible scales of the noise of a quantity without waveforms, whose values have no scatter that would show one, and
their prior probabilities, those of larger scales as for waveforms."""
SAME_SCALE = 1.1
"""Ratio of two scales up to which they are the same: posterior standard deviations differ by no more."""
TOO_LOUD = 2.0
"""Scale above which the scatter of all waveforms of a quantity may be a missing effect."""
LARGER_BY, SMALLER_BY = 1.0, 0.1
"""Prior means of the size of the log of a scale above and below 1 (Laplace): noise is understated rather than
overstated, and beyond the first harmonics a smaller scale looks like a longer correlation."""


@dataclass(frozen=True)
class Noise:
    """Noise of the waveforms of one quantity.

    scale: its standard deviation over the stated one. correlation_time: of its correlation exp(-|t| / correlation_time)
    (Ornstein-Uhlenbeck), s; 0: white noise.
    """

    scale: float
    correlation_time: float = 0.0


@dataclass(frozen=True)
class Alternative:
    """A possible noise and its log prior."""

    noise: Noise
    log_prior: float


@dataclass(frozen=True)
class Estimate:
    """Noise of the waveforms of one quantity by their scatter.

    noise: the most probable one, None for the stated one. alternatives: all, with the scale that the scatter shows, but
    none smaller than both the stated and the most probable one, and none without scatter. Of a quantity without
    waveforms, the noise is taken as stated, and the alternatives are `OF_VALUES`.
    """

    noise: Noise | None
    alternatives: tuple[Alternative, ...]

    def chosen(self, number: int) -> "Estimate":
        """Return the estimate with one of the alternatives as the most probable noise; the first is the stated one."""
        return Estimate(self.alternatives[number].noise if number else None, self.alternatives)

    @property
    def scale(self) -> float:
        """Of the most probable noise."""
        return 1.0 if self.noise is None else self.noise.scale

    @property
    def correlated(self) -> bool:
        """Whether the most probable noise is."""
        return self.noise is not None and self.noise.correlation_time > 0.0


def most_probable(estimates: dict[str, Estimate]) -> dict[str, Noise]:
    """Return the most probable noise of quantities whose waveforms show another than the stated, white one."""
    return {quantity: estimate.noise for quantity, estimate in estimates.items() if estimate.noise is not None}


def differing(estimates: dict[str, Estimate], known: dict[str, Estimate], right: bool) -> dict[str, Estimate]:
    """Return those of quantities whose scale differs from the known one by more than `SAME_SCALE`, or whose kind does.

    right: whether they are those about a right model; if something is missing from it, only a smaller scale counts.
    """

    def other(now: Estimate, before: Estimate) -> bool:
        larger, kind = now.scale > before.scale * SAME_SCALE, now.correlated != before.correlated
        return now.scale * SAME_SCALE < before.scale or (right and (larger or kind))

    return {quantity: now for quantity, now in estimates.items() if other(now, known[quantity])}


def noise_estimates(problem: Problem, residual: np.ndarray) -> dict[str, Estimate]:
    """Estimate the noise of each quantity, from its waveforms if it has any.

    Mean and first harmonics of each residual waveform, as many as leave half of the samples, are projected out, because
    there a missing effect may be; standard deviations are those with the model's floor and the time-step allowance.
    Scale and correlation are those of the largest likelihood of what is left, in which every waveform has a scale of
    its own and the median waveform counts: missing effects are in some waveforms, noise in all. The most probable of
    three is taken: noise as stated, larger white noise, and correlated noise of any scale. The scatter beyond the first
    harmonics says little of how long noise lasts, the variance of a mean depends on it, and a missing effect with sharp
    features is part of the scatter: so the others are returned, too.

    Parameters
    ----------
    problem
        Measurements.
    residual
        Whitened residual of the fitted data, which shows the noise: (M,).

    Returns
    -------
    dict
        Quantity → estimate.
    """
    by_quantity: dict[str, list[_Waveform]] = {}
    for number, rows, phase in phases(problem, problem.train):
        series = problem.forward.measured[number]
        if phase is not None and series.time is not None:
            by_quantity.setdefault(series.quantity, []).append(_Waveform(series, phase, residual[rows]))
    of_values = Estimate(None, tuple(Alternative(Noise(scale), float(np.log(p))) for scale, p in OF_VALUES.items()))
    quantities = [series.quantity for series in problem.forward.measured if series.pullback is None]
    of_waveforms = {quantity: _estimate(waveforms) for quantity, waveforms in by_quantity.items()}
    return dict.fromkeys(quantities, of_values) | of_waveforms


class _Waveform:
    """What the first harmonics leave of a residual waveform."""

    def __init__(self, series: Measured, phase: np.ndarray, residual: np.ndarray):
        count = min(HARMONICS, (phase.size // 2 - 1) // 2)
        basis = fourier_basis(phase, count)
        self.series, self.left = series, np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :]
        self.values = self.left.T @ residual
        self.step = float(np.median(np.diff(series.sample_times))) if phase.size > 1 else series.period

    def fit(self, correlation_time: float) -> tuple[float, float]:
        """Return the mean square of the whitened values, without the largest, and the log likelihood with it."""
        correlation = _correlation(self.series, correlation_time) if correlation_time else np.eye(len(self.left))
        factor = np.linalg.cholesky(self.left.T @ correlation @ self.left)
        square = solve_triangular(factor, self.values, lower=True) ** 2
        square = max(trimmed_mean_square(square, TRIMMED), 1e-300)
        return square, -0.5 * len(self.values) * np.log(square) - float(np.log(np.diag(factor)).sum())


def _estimate(waveforms: list[_Waveform]) -> Estimate:
    """Return the noise of some waveforms."""
    waveforms = [one for one in waveforms if len(one.values) > 1]
    if not waveforms:
        return Estimate(None, ())
    step, freedom = float(np.median([one.step for one in waveforms])), sum(len(one.values) for one in waveforms)
    longest = LONGEST * min(one.series.period for one in waveforms)
    times = [0.0, *(-step / np.log(correlation) for correlation in CORRELATIONS)]
    times += [time for correlation in OF_DENSE_SAMPLES if (time := -step / np.log(correlation)) <= longest]
    fits = np.array([[one.fit(time) for one in waveforms] for time in times])
    # The median of many values varies more than their mean, by this factor.
    known = 2.0 / np.pi if len(waveforms) > 2 else 1.0
    squares = np.median(fits[:, :, 0], axis=1)
    # Each waveform has a scale of its own in its likelihood; their common one has a prior.
    free = known * len(waveforms) * np.median(fits[:, :, 1] - fits[0, :, 1], axis=1)
    scales = 0.5 * np.log(squares)
    # The likelihood, normal about the best scale, times the prior density there, is integrated over all scales.
    width = np.sqrt(np.pi / (known * freedom))
    by_scale = np.log(width / (LARGER_BY + SMALLER_BY)) - np.abs(scales) / np.where(scales > 0, LARGER_BY, SMALLER_BY)
    free += by_scale
    stated = np.log(AS_STATED) - 0.5 * known * freedom * (squares[0] - 1.0 - np.log(squares[0]))
    white = np.log(OTHER) + free[0]
    correlated = np.log(CORRELATED) + logsumexp(free[1:]) - np.log(len(times) - 1)
    # Where standard deviations are overstated, they are kept: the answer then warns of them.
    each = [Noise(float(np.sqrt(square)), float(time)) for square, time in zip(squares, times, strict=True)]
    noise: Noise | None = each[0] if white > correlated else each[1 + int(np.argmax(free[1:]))]
    if stated >= max(white, correlated) or (white > correlated and squares[0] < 1.0):
        noise = None
    priors = by_scale + np.log([OTHER] + [CORRELATED / (len(times) - 1)] * (len(times) - 1))
    smallest = 1.0 if noise is None else min(1.0, noise.scale)
    others = [Alternative(one, float(prior)) for one, prior in zip(each, priors, strict=True) if one.scale >= smallest]
    return Estimate(noise, (Alternative(Noise(1.0), float(np.log(AS_STATED))), *others))


def _correlation(series: Measured, correlation_time: float) -> np.ndarray:
    return around_the_beat(series.sample_times, series.period, correlation_time)


def white_and_correlated(series: Measured, noise: Noise) -> tuple[float, np.ndarray]:
    """Decompose noise in one series, in units of the stated standard deviation (k samples).

    Returns the standard deviation of its white part, and shapes (n, k) with standard normal weights. Single values are
    as uncertain as the waveforms of their quantity, but no less than stated.
    """
    if series.statistic != "waveform":
        return max(noise.scale, 1.0), np.zeros((0, series.value.size))
    if noise.correlation_time == 0.0:
        return noise.scale, np.zeros((0, series.value.size))
    white, shapes = white_and_shapes(_correlation(series, noise.correlation_time))
    return noise.scale * white, noise.scale * shapes


def with_correlated(problem: Problem) -> np.ndarray:
    """Return the standard deviations (N,) of the measurements, including correlated noise."""
    return np.sqrt(problem.sd**2 + np.sum(problem.forward.noise_shapes**2, axis=0))
