"""Errors of recorded waveforms that no effect of the library expresses, for development."""

from collections.abc import Callable, Sequence

import numpy as np

from coronaryuq.discrepancy.hidden.nature import Outside, Records

Channel = tuple[str, str]
"""Quantity and location of a recorded waveform."""


def hysteretic_flow_meter(channels: Sequence[Channel], random: np.random.Generator) -> Outside | None:
    """Return a flow meter whose reading lags within a dead band, as of a mechanical rotameter.

    The reading moves only when the flow leaves a band about it (play operator) with a half-width of 0.15 of the mean
    flow of the first condition. Source: Visintin, Differential Models of Hysteresis (1994), ch. III.
    """
    channel = one_of("flow", channels, random)
    if channel is None:
        return None

    def law(records: Records, periods: dict[str, float]) -> Records:
        half = 0.15 * level(records, channel)
        return with_channel(records, channel, lambda wave, _: play(wave, half))

    return Outside(records=law)


def play(wave: np.ndarray, half: float) -> np.ndarray:
    """Return the periodic output of a play operator of half-width `half`, (k,)."""
    read, output = float(wave[0]), np.empty_like(wave)
    for _ in range(2):  # the first turn forgets the initial state
        for k, value in enumerate(wave):
            read = min(max(read, value - half), value + half)
            output[k] = read
    return output


def channel_crosstalk(channels: Sequence[Channel], random: np.random.Generator) -> Outside | None:
    """Return a flow channel that picks up the pulse of a pressure channel of the same recorder.

    Added: 0.6 of the mean flow of the first condition times the relative deviation of the pressure from its mean.
    Source: Ott, Noise Reduction Techniques in Electronic Systems, 2nd ed. (1988), ch. 2 (coupling of channels).
    """
    victim, source = one_of("flow", channels, random), one_of("pressure", channels, random)
    if victim is None or source is None:
        return None

    def law(records: Records, periods: dict[str, float]) -> Records:
        size = 0.6 * level(records, victim)

        def add(wave: np.ndarray, waves: dict[Channel, np.ndarray]) -> np.ndarray:
            pressure = waves[source]
            return wave + size * (pressure / pressure.mean() - 1.0)

        return with_channel(records, victim, add)

    return Outside(records=law)


def quantised_recording(channels: Sequence[Channel], random: np.random.Generator) -> Outside | None:
    """Return a pressure channel digitised in steps of 0.3 of its pulse in the first condition.

    Source: Widrow & Kollár, Quantization Noise (2008), ch. 1.
    """
    channel = one_of("pressure", channels, random)
    if channel is None:
        return None

    def law(records: Records, periods: dict[str, float]) -> Records:
        step = 0.3 * float(np.ptp(next(iter(records.values()))[channel]))
        return with_channel(records, channel, lambda wave, _: step * np.round(wave / step))

    return Outside(records=law)


def one_of(quantity: str, channels: Sequence[Channel], random: np.random.Generator) -> Channel | None:
    """Draw a channel of a quantity; None if there is none."""
    mine = [channel for channel in channels if channel[0] == quantity]
    return mine[int(random.integers(len(mine)))] if mine else None


def level(records: Records, channel: Channel) -> float:
    """Return the size of a channel's mean in the first condition."""
    return float(np.abs(next(iter(records.values()))[channel].mean()))


def with_channel(
    records: Records, channel: Channel, change: Callable[[np.ndarray, dict[Channel, np.ndarray]], np.ndarray]
) -> Records:
    return {name: waves | {channel: change(waves[channel], waves)} for name, waves in records.items()}


RECORDINGS = {law.__name__: law for law in (hysteretic_flow_meter, channel_crosstalk, quantised_recording)}
