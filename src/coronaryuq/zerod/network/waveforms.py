"""Waveforms of a network's boundary conditions, on one grid."""

import numpy as np

from coronaryuq.case.network.network import Network

WAVE_POINTS = 1201
"""Points of a waveform that differs between samples or conditions; four times as fine as the steps of a cycle."""
DRIVES = {"PRESSURE": "P", "FLOW": "Q"}
"""Name of the waveform in each kind of boundary condition that drives a network."""
WAVEFORMS = DRIVES | {"CORONARY": "Pim", "CORONARY_VAR_RES": "Pim"}
"""Name of the waveform in each kind of boundary condition that has one."""
CONTENT, HARMONICS = 40.0, 20
"""Frequency (Hz) beyond which pressures and flows of the circulation have no content, so that a reading is noise there.

Twenty harmonics of the heart rate describe even the derivative of an arterial pressure (Nichols & O'Rourke, McDonald's
Blood Flow in Arteries)."""


def sampled(network: Network, name: str) -> np.ndarray:
    """Resample the waveform "BLOCK.parameter" on an even grid over its cycle, both ends included, (WAVE_POINTS,)."""
    block, _, parameter = name.rpartition(".")
    values = network.bed_values(block)
    return resampled(np.asarray(values[parameter], dtype=float), np.asarray(values["t"], dtype=float))


def resampled(values: np.ndarray, time: np.ndarray | None = None) -> np.ndarray:
    """Resample a waveform, by default from an even grid, to `WAVE_POINTS` points with both ends."""
    if len(values) == 1:
        return np.full(WAVE_POINTS, float(values[0]))
    if time is None and len(values) == WAVE_POINTS:
        return values
    at = np.linspace(0.0, 1.0, len(values)) if time is None else time
    return np.interp(np.linspace(at[0], at[-1], WAVE_POINTS), at, values)


def without_noise(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a measured beat as the smooth function that its readings sample, without what it has beyond `CONTENT`.

    A vessel's compliance turns the slope of a pressure into flow, so a model driven by noise predicts much more of it,
    and one driven by straight lines between readings less; an error of a probe that smooths this, as a delay by a part
    of a time step does, then looks real.

    Parameters
    ----------
    time, values
        Readings (n,), s and any unit; the last is the first of the next beat.

    Returns
    -------
    time, values
        At least `WAVE_POINTS` even times, and values; those given if they are fewer than two per harmonic.
    """
    even = np.linspace(time[0], time[-1], len(time) - 1, endpoint=False)
    if len(even) < 2 * HARMONICS:
        return time, values
    spectrum = np.fft.rfft(np.interp(even, time, values))
    within = np.arange(len(spectrum)) <= CONTENT * (time[-1] - time[0])
    count = max(len(even), WAVE_POINTS - 1)
    smooth = np.fft.irfft(np.where(within, spectrum, 0.0), count) * (count / len(even))
    return np.linspace(time[0], time[-1], count + 1), np.append(smooth, smooth[0])
