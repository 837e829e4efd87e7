"""Waveforms of a network's boundary conditions, on one grid."""

import numpy as np

from coronaryuq.case.network.network import Network

WAVE_POINTS = 1201
"""Points of a waveform that differs between samples or conditions; four times as fine as the steps of a cycle."""
DRIVES = {"PRESSURE": "P", "FLOW": "Q"}
"""Name of the waveform in each kind of boundary condition that drives a network."""
WAVEFORMS = DRIVES | {"CORONARY": "Pim", "CORONARY_VAR_RES": "Pim"}
"""Name of the waveform in each kind of boundary condition that has one."""


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
