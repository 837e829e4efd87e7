"""Noise of a measured waveform that drives a network, removed where the circulation has no content."""

import numpy as np

CONTENT = 40.0
"""Frequency (Hz) beyond which pressures and flows of the circulation have no content, so that a reading is noise there.

Twenty harmonics of the heart rate describe even the derivative of an arterial pressure (Nichols & O'Rourke, McDonald's
Blood Flow in Arteries)."""


def without_noise(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Remove what a measured beat has beyond `CONTENT`.

    A vessel's compliance turns the slope of a pressure into flow, so a model driven by noise predicts much more of it;
    an error of a probe that smooths this, as a delay by a part of a time step does, then looks real.

    Parameters
    ----------
    time, values
        Readings (n,), s and any unit; the last is the first of the next beat.

    Returns
    -------
    time, values
        As many even times and readings; those given if they are too far apart to have such content.
    """
    even = np.linspace(time[0], time[-1], len(time) - 1, endpoint=False)
    spectrum = np.fft.rfft(np.interp(even, time, values))
    within = np.arange(len(spectrum)) <= CONTENT * (time[-1] - time[0])
    if within.all():
        return time, values
    smooth = np.fft.irfft(np.where(within, spectrum, 0.0), len(even))
    return np.append(even, time[-1]), np.append(smooth, smooth[0])
