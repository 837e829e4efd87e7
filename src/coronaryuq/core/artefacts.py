"""Artefacts of a recorded waveform of one beat: a lost or clipped signal, a spike, further beats."""

import numpy as np

LOW, HIGH = 0.3, 0.7
"""Fractions of the range of a waveform between which it rises once in each beat."""


def longest_rest(values: np.ndarray) -> tuple[int, int]:
    """Return the first sample of the longest part of a waveform (n,) that stays at one value, and its length."""
    ends = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0.0)
    longest = int(np.argmax(np.diff(ends)))
    return int(ends[longest]), int(np.diff(ends)[longest])


def largest_spike(values: np.ndarray) -> tuple[int, float]:
    """Return the sample of a beat (n,) farthest from the median of five about it, and that median.

    The last sample is the first one of the next beat.
    """
    periodic = np.concatenate([values[-3:-1], values, values[1:3]])
    median = np.median(np.lib.stride_tricks.sliding_window_view(periodic, 5), axis=1)
    spike = int(np.argmax(np.abs(values - median)))
    return spike, float(median[spike])


def rises(values: np.ndarray) -> int:
    """Count how often a periodic waveform (n,) rises from below `LOW` to above `HIGH` of its range."""
    share = (values - values.min()) / max(np.ptp(values), 1e-12)
    high = np.where(share > HIGH, 1, np.where(share < LOW, 0, -1))
    states = high[high >= 0]
    return int(np.sum(np.diff(states, append=states[0]) == 1)) if len(states) else 0
