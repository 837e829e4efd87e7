"""Linear responses of measuring devices to periodic signals: any impulse response that is smooth and dies out.

The weights k(u) of the lags u are a Gaussian process with the covariance s^2 / (2 T^2) min(exp(-u/T), exp(-v/T)), the
"tuned/correlated" kernel of system identification: they are smooth, and vanish for lags far beyond the time scale T.
With it the share that arrives late, the integral of k, has the standard deviation s = 1. A low-pass (k = exp(-u/T)/T),
a filter with two poles, a dispersive line and an early echo are all near to some plausible k; a delay of the whole
signal by much more than a sample is not. As a function of exp(-u/T), k is Brownian motion, so its shapes are sines
(Karhunen and Loève), of which the first `SHAPES` are kept, with at least three quarters of the variance at every
harmonic of a beat; their weights are standard normal.

References
----------
Pillonetto & De Nicolao, Automatica 46 (2010) 81; Chen, Ohlsson & Ljung, Automatica 48 (2012) 1525 (kernel TC)
"""

from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from coronaryuq.zerod.network.waveforms import CONTENT

SHAPES = 8
"""Shapes of impulse responses; their variances fall as those of Brownian motion, to 1/225 of the first."""
POINTS = 512
"""Points of a beat on which a signal is interpolated."""
LAGS, LONGEST = 601, 12.0
"""Points of the integral over lags, and the longest lag in time scales."""


@lru_cache(maxsize=64)
def late_parts(time_scale: float, frequency: bytes) -> np.ndarray:
    """Return the transfer function (`SHAPES`, k) of the part of a signal that each shape of unit weight delays.

    Parameters
    ----------
    time_scale
        T, s.
    frequency
        Bytes of the frequencies (k,), Hz, by which the results are kept.

    Returns
    -------
    ndarray
        Complex.
    """
    lags = np.linspace(0.0, LONGEST * time_scale, LAGS)
    rates = np.pi * (np.arange(SHAPES)[:, None] + 0.5)
    # Brownian motion has the shapes sqrt(2) sin(rate v) / rate.
    weights = np.sin(rates * np.exp(-lags / time_scale)) / rates / time_scale
    weights *= (lags[1] - lags[0]) * np.where((lags == lags[0]) | (lags == lags[-1]), 0.5, 1.0)
    return weights @ np.exp(-2j * np.pi * np.multiply.outer(lags, np.frombuffer(frequency)))


def amplitudes(phase: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Return the complex amplitudes (h,) of a waveform's harmonics, the first one first, up to `CONTENT`.

    Parameters
    ----------
    phase, values
        Samples (n,) over a beat, by time over the period, in order; the last one lies less than a beat after the first.
    period
        s.
    """
    closed = np.append(phase, phase[0] + 1.0), np.append(values, values[0])
    smooth = CubicSpline(*closed, bc_type="periodic")
    return 2.0 * np.fft.rfft(smooth(np.arange(POINTS) / POINTS))[1 : int(CONTENT * period) + 1] / POINTS


def picked_up(signal: np.ndarray, phase: np.ndarray, period: float, time_scale: float) -> np.ndarray:
    """Return what a response to a signal adds at some phases: a part at once, and what each shape of k delays.

    Parameters
    ----------
    signal
        `amplitudes` of the signal, (h,).
    phase
        Times of the readings over the period, (n,).
    period, time_scale
        s.

    Returns
    -------
    ndarray
        (n, 1 + `SHAPES`), in units of the signal.
    """
    number = np.arange(1, len(signal) + 1)
    response = np.vstack([np.ones(len(signal)), late_parts(time_scale, (number / period).tobytes())])
    return ((response * signal) @ np.exp(2j * np.pi * np.multiply.outer(number, phase))).real.T


def read_late(signal: np.ndarray, phase: np.ndarray, period: float, time_scale: float) -> np.ndarray:
    """Return what a device adds at some phases that reads a part of its signal late: (n, `SHAPES`), as `picked_up`.

    What arrives late is missing where it would have been, so that steady readings are right:
    X_read(t) = X(t) + integral k(u) (X(t - u) - X(t)) du.
    """
    added = picked_up(signal, phase, period, time_scale)
    steady = late_parts(time_scale, np.zeros(1).tobytes())[:, 0].real
    return added[:, 1:] - added[:, :1] * steady
