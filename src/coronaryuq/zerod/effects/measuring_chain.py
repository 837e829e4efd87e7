"""Between a vessel and the recording: delay, low-pass, resonance, clock, average of beats, drift of a wire."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter, Series, Values
from coronaryuq.zerod.effects.sensors import EVERY_PRESSURE, NATIVE

EVERY_FLOW = "every flow"
BEATS = 15
"""Nodes of the Gauss-Hermite rule by which beats are averaged."""
MOST_AVERAGES = 64
"""Averages of beats that are kept: a fit reads all series, and differentiates by most parameters, with the same one."""
MEASUREMENT_OF_FLOW = "Nichols et al., McDonald's Blood Flow in Arteries, 6th ed. (2011), measurement of flow"


class Recorded(Effect):
    """Base class of what acts on the waveforms of one instrument."""

    side = "measurement"
    native = NATIVE
    changes_shape = True
    quantities: ClassVar[tuple[str, ...]] = ("pressure",)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        waveforms = (s for s in observed if s.statistic == "waveform" and s.quantity in self.quantities)
        return list(dict.fromkeys(s.location for s in waveforms))

    def covers(self, place: str, series: Series) -> bool:
        return series.quantity in self.quantities and series.location == place


class AloneOrTogether(Recorded):
    """Base class of what acts on each waveform or, if one device reads several, on all of its quantity."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        alone = super().places(anatomy, observed)
        return [*alone, f"every {self.quantities[0]}"] if len(alone) > 1 else alone

    def covers(self, place: str, series: Series) -> bool:
        return series.quantity in self.quantities and place in (series.location, f"every {series.quantity}")


class Chain(Recorded):
    """Base class of linear responses of an instrument, the same at all times: two of them may be a third.

    Sizes are in seconds, as those of a line, a filter or a trigger do not depend on the heart rate.
    """


class _Delay(Chain):
    """Pure delay: the waveform is read at an earlier time, which also keeps a jump between two time steps."""

    def delay(self, place: str, sizes: Values, series: Series) -> np.ndarray:
        affected = series.statistic == "waveform" and self.covers(place, series)
        return np.asarray(sizes["delay"]) if affected else np.zeros(1)


class Reshaping(Effect):
    """Base class of what changes the shape of the waveforms that it covers; a mean, which has none, is left."""

    @abstractmethod
    def covers(self, place: str, series: Series) -> bool:
        """Return whether the effect at a place acts on a series."""

    @abstractmethod
    def reshaped(self, sizes: Values, series: Series, wave: np.ndarray) -> np.ndarray:
        """Return the waveforms (n, k) of a series as they are read, see `Effect.read`."""

    def read(
        self,
        place: str,
        sizes: Values,
        series: Series,
        wave: np.ndarray,
        other: np.ndarray | None,
        anatomy: Anatomy,
    ) -> np.ndarray:
        if series.statistic == "mean" or not self.covers(place, series):
            return wave
        return self.reshaped(sizes, series, wave)


class LinearFilter(AloneOrTogether, Chain, Reshaping):
    """Filter with a transfer function.

    Each harmonic of the simulated waveform is multiplied by the transfer function, which is the steady response to a
    periodic beat: no transient, whatever the sampling of the measured waveform. The mean is unchanged.
    """

    @abstractmethod
    def transfer(self, sizes: Values, frequency: np.ndarray) -> np.ndarray:
        """Return the transfer function (n, k) at frequencies (k,), Hz, for sizes (n,); 1 at zero frequency."""

    def reshaped(self, sizes: Values, series: Series, wave: np.ndarray) -> np.ndarray:
        points = wave.shape[1]
        transfer = self.transfer(sizes, np.fft.rfftfreq(points, series.period / points))
        return np.fft.irfft(np.fft.rfft(wave) * transfer, points)


class _LowPass(LinearFilter):
    def transfer(self, sizes: Values, frequency: np.ndarray) -> np.ndarray:
        return 1.0 / (1.0 + 2j * np.pi * np.asarray(sizes["time_constant"])[:, None] * frequency)


class PressureDelay(_Delay):
    """Pressure read late, as through a fluid-filled line."""

    name = "pressure_delay"
    formula = "P_read(t) = P(t - d)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure waveform shifted in time in every condition"
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.03, "delay in seconds"),)


class FlowDelay(_Delay):
    """Flow read late, as through the filter of a probe or in images triggered on another signal."""

    name = "flow_delay"
    formula = "Q_read(t) = Q(t - d)"
    source = MEASUREMENT_OF_FLOW
    signature = "one flow waveform shifted in time in every condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.03, "delay in seconds"),)


class _ClockRate(AloneOrTogether, Reshaping):
    """Clock of a recorder that runs too fast or too slowly, or samples at another rate than stated.

    What is read at the end of a beat is from well before it, or from the next one.
    """

    source = "own derivation; the spread, a few per cent as of paper or film at a wrong speed, is our judgement"
    parameters = (
        Parameter("rate", "1", "normal", 0.0, 0.03, "rate of the clock above its nominal one, as a fraction"),
    )

    def reshaped(self, sizes: Values, series: Series, wave: np.ndarray) -> np.ndarray:
        points = wave.shape[1]
        at = np.arange(points) * (1.0 - np.asarray(sizes["rate"])[:, None])
        return np.array(
            [np.interp(own, np.arange(points), one, period=points) for own, one in zip(at, wave, strict=True)]
        )


class PressureClockRate(_ClockRate):
    """Pressure whose recorder's clock is fast or slow."""

    name = "pressure_clock_rate"
    formula = "P_read(t) = P((1 - r) t), t from the start of the beat"
    signature = "one pressure, or every pressure, the later in the beat the later read, in every condition"


class FlowClockRate(_ClockRate):
    """Flow whose recorder's clock is fast or slow."""

    name = "flow_clock_rate"
    formula = "Q_read(t) = Q((1 - r) t), t from the start of the beat"
    signature = "one flow, or every flow, the later in the beat the later read, in every condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)


class OneDevice(Effect):
    """Base class of what acts on the waveforms of several places together.

    Places: all waveforms, or all of one quantity, as from an imaging device when a pressure drives the model.
    """

    side = "measurement"
    native = NATIVE
    changes_shape = True
    quantities_of: ClassVar[dict[str, tuple[str, ...]]] = {
        "every waveform": ("pressure", "flow", "volume"),
        EVERY_PRESSURE: ("pressure",),
        EVERY_FLOW: ("flow",),
    }

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        together: dict[tuple, str] = {}
        for place in self.quantities_of:
            read = {(s.quantity, s.location) for s in observed if s.statistic == "waveform" and self.covers(place, s)}
            # A single waveform is left to its own sensor. Two names for the same waveforms are one place.
            if len(read) > 1:
                together[tuple(sorted(read))] = place
        return list(together.values())

    def covers(self, place: str, series: Series) -> bool:
        return series.quantity in self.quantities_of[place]


class TriggerDelay(OneDevice, _Delay):
    """Delay common to the waveforms of several places: another trigger, or another start of the beat than modelled."""

    name = "trigger_delay"
    formula = "X_read(t) = X(t - d) for every waveform X of one device"
    source = MEASUREMENT_OF_FLOW
    signature = "several waveforms shifted by the same time in every condition"
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.1, "delay in seconds"),)


class BeatAveraging(OneDevice, Reshaping):
    """Average over beats of varying period, which are aligned at their start, so that late phases blur.

    Over a few minutes of rest the period has a standard deviation of about 50 ms of 900 ms.
    """

    name = "beat_averaging"
    formula = "X_read(p) = E X(p (1 + s b)), p the phase of the beat, b standard normal"
    source = "Task Force of the ESC and NASPE, Circulation 93 (1996) 1043 (variation of the period)"
    signature = "several waveforms smoothed in every condition, the more the later in the beat; their start is right"
    parameters = (
        Parameter("period_spread", "1", "lognormal", 0.05, 0.5, "standard deviation of the period over its mean"),
    )

    def reshaped(self, sizes: Values, series: Series, wave: np.ndarray) -> np.ndarray:
        spreads = np.asarray(sizes["period_spread"]).tolist()
        return np.array([_average(s, len(own)) @ own for s, own in zip(spreads, wave, strict=True)])


@lru_cache(MOST_AVERAGES)
def _average(spread: float, points: int) -> csr_array:
    """Return the matrix (points, points) that averages a waveform, linear between its points, over beats."""
    beats, weights = np.polynomial.hermite_e.hermegauss(BEATS)
    at = np.arange(points)[:, None] * (1.0 + spread * beats)
    before = np.floor(at)
    after = at - before
    rows = np.broadcast_to(np.arange(points)[:, None], at.shape)
    columns = np.concatenate([before, before + 1.0], axis=1).astype(int) % points
    shares = np.concatenate([weights * (1.0 - after), weights * after], axis=1) / weights.sum()
    return csr_array((shares.ravel(), (np.tile(rows, 2).ravel(), columns.ravel())), shape=(points, points))


class PressureLowPass(_LowPass):
    """Pressure smoothed by an overdamped line or an amplifier's filter."""

    name = "pressure_low_pass"
    formula = "tau dP_read/dt + P_read = P: H(f) = 1 / (1 + 2 pi i f tau)"
    source = "Gardner, Anesthesiology 54 (1981) 227 (overdamped lines)"
    signature = (
        "one pressure, or every pressure, smoothed and late in every condition: its pulse smaller, its mean right"
    )
    parameters = (Parameter("time_constant", "s", "lognormal", 0.015, 0.7, "time constant in seconds"),)


class FlowLowPass(_LowPass):
    """Flow smoothed by the filter of a probe.

    Gessner & Bergel measured phase lags of 3.6 to 4.9 degrees per Hz, as of time constants of 10 to 14 ms.
    """

    name = "flow_low_pass"
    formula = "tau dQ_read/dt + Q_read = Q: H(f) = 1 / (1 + 2 pi i f tau)"
    source = "Gessner & Bergel, J. Appl. Physiol. 19 (1964) 1209 (frequency response of flowmeters)"
    signature = "one flow, or every flow, smoothed and late in every condition: its pulse smaller, its mean right"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("time_constant", "s", "lognormal", 0.015, 0.7, "time constant in seconds"),)


class CatheterResonance(LinearFilter):
    """Resonance of a fluid-filled catheter and its transducer, a damped oscillator.

    Gardner's catheters have 10 to 20 Hz and damping ratios of 0.15 to 0.4. The first size is the period, which
    vanishes with the effect; it is reported as a frequency.
    """

    name = "catheter_resonance"
    formula = "H(f) = 1 / (1 - (f T)^2 + 2 i zeta f T), T = 1 / f_n the natural period"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure, or every pressure, overshoots after each steep change and rings; its mean is right"
    parameters = (
        Parameter("natural_period", "s", "lognormal", 0.07, 0.35, "natural period in seconds"),
        Parameter("damping", "1", "lognormal", 0.25, 0.4, "damping ratio"),
    )

    def transfer(self, sizes: Values, frequency: np.ndarray) -> np.ndarray:
        ratio = np.asarray(sizes["natural_period"])[:, None] * frequency
        return 1.0 / (1.0 - ratio**2 + 2j * np.asarray(sizes["damping"])[:, None] * ratio)

    def describe(self, parameter: Parameter, size: float, anatomy: Anatomy) -> tuple[str, float]:
        if parameter.name == "natural_period":
            return "natural frequency in Hz", 1.0 / size
        return super().describe(parameter, size, anatomy)

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"natural frequency, Hz": 1.0 / sizes["natural_period"], "damping ratio": sizes["damping"]}


class WireDrift(Effect):
    """Drift of a pressure wire during a pullback beyond the usual one, linear in time since its equalisation.

    Places: each pullback. The usual drift is part of the pullback's noise.
    """

    name = "wire_drift"
    formula = "P_read = P + d t / t_end, t the time since equalisation"
    source = "Cook et al., Circ. Cardiovasc. Interv. 9 (2016) e002988 (drift of pressure wires; 2 mmHg is a small one)"
    signature = "all pressures of a pullback off by nearly the same amount, also where the wire is back at the start"
    native = NATIVE
    side = "measurement"
    parameters = (Parameter("drift", "mmHg", "normal", 0.0, 5.0, "drift in mmHg at the end of the pullback"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return list(dict.fromkeys(pullback_name(s) for s in observed if s.pullback is not None))

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        return [
            values + np.asarray(sizes["drift"])[:, None] * one.pullback.response
            if one.pullback is not None and pullback_name(one) == place
            else values
            for one, values in zip(series, predicted, strict=True)
        ]


def pullback_name(series: Series) -> str:
    """Return the name of a pullback: its path and condition."""
    return f"{series.location} under {series.condition}"
