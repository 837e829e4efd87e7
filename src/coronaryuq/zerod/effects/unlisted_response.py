"""Unlisted linear response of a measuring device: any impulse response that keeps steady readings."""

from functools import lru_cache

import numpy as np

from coronaryuq.zerod.effects.base import Parameter, Values
from coronaryuq.zerod.effects.measuring_chain import LinearFilter
from coronaryuq.zerod.network.waveforms import CONTENT

SHAPES = 8
"""Shapes of impulse responses; their variances fall as those of Brownian motion, to 1/225 of the first."""
POINTS = 512
"""Points of a beat on which a signal that is picked up is interpolated."""
LAGS, LONGEST = 601, 12.0
"""Points of the integral over lags, and the longest lag in time scales."""


class UnlistedResponse(LinearFilter):
    """A device through which parts of the signal arrive late, each part with a weight of its own.

    The weights k(u) of the lags u are a Gaussian process with the covariance s^2 / (2 T^2) min(exp(-u/T), exp(-v/T)),
    the "tuned/correlated" kernel of system identification: they are smooth, and vanish for lags far beyond the time
    scale T. With it the share that arrives late, the integral of k, has the standard deviation s = 1. A low-pass
    (k = exp(-u/T)/T), a filter with two poles, a dispersive line and an early echo are all near to some plausible k; a
    delay of the whole signal by much more than a sample is not. As a function of exp(-u/T), k is
    Brownian motion, so its shapes are sines (Karhunen and Loève), of which the first `SHAPES` are kept, with at least
    three quarters of the variance at every harmonic of a beat; their weights are the sizes. The effect is linear in its
    sizes. It is not in the library: a search weighs it as one form of something else.

    Formula: X_read(t) = X(t) + integral k(u) (X(t - u) - X(t)) du

    References
    ----------
    Pillonetto & De Nicolao, Automatica 46 (2010) 81; Chen, Ohlsson & Ljung, Automatica 48 (2012) 1525 (kernel TC)
    """

    nameable = False
    parameters = tuple(
        Parameter(f"weight_{number + 1}", "1", "normal", 0.0, 1.0, f"weight of shape {number + 1}")
        for number in range(SHAPES)
    )

    def __init__(self, quantity: str, time_scale: float):
        """Describe a device that reads a quantity, "pressure" or "flow", with a time scale T in seconds."""
        # Of the instance, because responses differ in these; a run is known by the names of its effects.
        self.name = f"unlisted_{quantity}_response_{time_scale:g}_s"  # type: ignore[misc]
        self.quantities = (quantity,)  # type: ignore[misc]
        self.time_scale = time_scale

    def transfer(self, sizes: Values, frequency: np.ndarray) -> np.ndarray:
        weights = np.stack([np.asarray(sizes[parameter.name]) for parameter in self.parameters], axis=-1)
        return 1.0 + weights @ shapes(self.time_scale, frequency.tobytes())


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


def shapes(time_scale: float, frequency: bytes) -> np.ndarray:
    """Return the change (`SHAPES`, k) of the transfer function by each shape of unit weight; as `late_parts`.

    What arrives late is missing where it would have been, so that it is zero at zero frequency.
    """
    return late_parts(time_scale, frequency) - late_parts(time_scale, np.zeros(1).tobytes())


def amplitudes(phase: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Return the complex amplitudes (h,) of a waveform's harmonics, the first one first, up to `CONTENT`.

    Parameters
    ----------
    phase, values
        Samples (n,) over a beat, by time over the period.
    period
        s.
    """
    even = np.interp(np.arange(POINTS) / POINTS, phase, values, period=1.0)
    return 2.0 * np.fft.rfft(even)[1 : int(CONTENT * period) + 1] / POINTS


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
