"""Errors of pressure and flow sensors: offset, gain, delay, and offsets and delays common to several sensors."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter, Series, Values

NATIVE = "acts on predictions; the network stays the same"
EVERY_PRESSURE = "every pressure"


class _Sensor(Effect):
    side = "measurement"
    native = NATIVE
    quantities: ClassVar[tuple[str, ...]] = ("pressure", "ratio")
    """Quantities that the sensor reads; of a ratio, its numerator."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return list(dict.fromkeys(s.location for s in observed if self._reads(s)))

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        return [
            self._read(sizes, values) if self._reads(s) and s.location == place else values
            for s, values in zip(series, predicted, strict=True)
        ]

    def _reads(self, series: Series) -> bool:
        return series.quantity in self.quantities

    def _read(self, sizes: Values, values: np.ndarray) -> np.ndarray:
        return values


class _Gain(_Sensor):
    def _read(self, sizes: Values, values: np.ndarray) -> np.ndarray:
        return values * (1.0 + np.asarray(sizes["gain"]))[:, None]


class _Delay(_Sensor):
    """Delay in seconds: that of a line, a filter or a trigger does not depend on the heart rate."""

    changes_shape = True

    def _reads(self, series: Series) -> bool:
        return series.statistic == "waveform" and super()._reads(series)

    def delay(self, place: str, sizes: Values, series: Series) -> np.ndarray:
        affected = self._reads(series) and series.location == place
        return np.asarray(sizes["delay"]) if affected else np.zeros(1)


class PressureOffset(_Sensor):
    """Zero error of a pressure transducer (drift, height)."""

    name = "pressure_offset"
    formula = "P_read = P + b"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure wrong by a constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean pressure of the series"),)

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        observed = list(predicted)
        for quantity in self.quantities:
            affected = [i for i, s in enumerate(series) if s.quantity == quantity and self._covers(place, s.location)]
            if affected:
                scale = np.mean([predicted[i].mean(axis=1) for i in affected], axis=0)
                for i in affected:
                    observed[i] = predicted[i] + (np.asarray(sizes["offset"]) * scale)[:, None]
        return observed

    def _covers(self, place: str, location: str) -> bool:
        return location == place


class SharedOffset(PressureOffset):
    """Zero error common to several pressures, as of a drifting wire moved from place to place.

    Places: every pressure except the root's, and every pressure. In the second case an FFR, the ratio of two pressures
    with the error, changes by b (1 - FFR) over the root pressure.
    """

    name = "shared_offset"
    formula = "P_read = P + b at several places"
    source = "Cook et al., Circ. Cardiovasc. Interv. 9 (2016) e002988 (drift of pressure wires)"
    signature = "several pressures wrong by one constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean of these pressures"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        read = [s for s in observed if self._reads(s)]
        quantities = {s.quantity for s in read}
        roots = (anatomy.inlet(root) for root in anatomy.roots)
        shared: dict[tuple, str] = {}
        for place in (EVERY_PRESSURE, *(f"{EVERY_PRESSURE} but {root}" for root in roots)):
            locations = frozenset(s.location for s in read if self._covers(place, s.location))
            # An error at a single location is left to its own sensor. Two names for the same locations are one place,
            # unless a ratio distinguishes them. Ratios alone do not determine an offset of all pressures.
            if len(locations) > 1 and (place != EVERY_PRESSURE or "pressure" in quantities):
                shared.setdefault((locations, place == EVERY_PRESSURE and "ratio" in quantities), place)
        return list(shared.values())

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        observed = super().observe(place, sizes, series, predicted)
        if place == EVERY_PRESSURE:
            for i in (i for i, s in enumerate(series) if s.quantity == "ratio"):
                observed[i] = predicted[i] + np.asarray(sizes["offset"])[:, None] * (1.0 - predicted[i])
        return observed

    def _covers(self, place: str, location: str) -> bool:
        return place != f"{EVERY_PRESSURE} but {location}"


class PressureGain(_Gain):
    """Gain error of a pressure transducer."""

    name = "pressure_gain"
    formula = "P_read = P (1 + g)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure wrong by a factor: its pulse changes with its mean"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.08, "gain minus 1"),)


class PressureDelay(_Delay):
    """Pressure read late, as through a fluid-filled line."""

    name = "pressure_delay"
    formula = "P_read(t) = P(t - d)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure waveform shifted in time in every condition"
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.03, "delay in seconds"),)


class FlowGain(_Gain):
    """Gain error of a flow probe."""

    name = "flow_gain"
    formula = "Q_read = Q (1 + g)"
    source = "Drost, Proc. San Diego Biomed. Symp. 17 (1978) 299 (transit-time flowmeter)"
    signature = "one flow wrong by a factor in every phase and condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.15, "gain minus 1"),)


class FlowDelay(_Delay):
    """Flow read late, as through the filter of a probe or in images triggered on another signal."""

    name = "flow_delay"
    formula = "Q_read(t) = Q(t - d)"
    source = "Nichols et al., McDonald's Blood Flow in Arteries, 6th ed. (2011), measurement of flow"
    signature = "one flow waveform shifted in time in every condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.03, "delay in seconds"),)


class TriggerDelay(_Delay):
    """Delay common to the waveforms of several places: another trigger, or another start of the beat than modelled.

    Places: all waveforms, or all of one quantity, as from an imaging device when a pressure drives the model.
    """

    name = "trigger_delay"
    formula = "X_read(t) = X(t - d) for every waveform X of one device"
    source = "Nichols et al., McDonald's Blood Flow in Arteries, 6th ed. (2011), measurement of flow"
    signature = "several waveforms shifted by the same time in every condition"
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.1, "delay in seconds"),)
    quantities_of: ClassVar[dict[str, tuple[str, ...]]] = {
        "every waveform": ("pressure", "flow", "volume"),
        EVERY_PRESSURE: ("pressure",),
        "every flow": ("flow",),
    }

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        triggered: dict[tuple, str] = {}
        for place in self.quantities_of:
            shifted = {(s.quantity, s.location) for s in observed if self._triggers(place, s)}
            # A delay of a single waveform is left to its own sensor. Two names for the same waveforms are one place.
            if len(shifted) > 1:
                triggered[tuple(sorted(shifted))] = place
        return list(triggered.values())

    def delay(self, place: str, sizes: Values, series: Series) -> np.ndarray:
        return np.asarray(sizes["delay"]) if self._triggers(place, series) else np.zeros(1)

    def _triggers(self, place: str, series: Series) -> bool:
        return series.statistic == "waveform" and series.quantity in self.quantities_of[place]
