"""Errors of sensors: offset, gain and delay of pressure, gain and delay of flow, what several of them share."""

from typing import ClassVar

import numpy as np

from coronaryuq.zerod.effects.base import Effect, Parameter

NATIVE = "measuring side: acts on predictions, the network stays as it is"
EVERY_PRESSURE = "every pressure"


class _Sensor(Effect):
    side = "measurement"
    native = NATIVE
    quantities = ("pressure", "ratio")
    """What the sensor reads; a ratio by its numerator."""

    def places(self, anatomy, observed=()):
        return list(dict.fromkeys(s.location for s in observed if self._reads(s)))

    def observe(self, place, sizes, series, predicted):
        return [
            self._read(sizes, values) if self._reads(s) and s.location == place else values
            for s, values in zip(series, predicted, strict=True)
        ]

    def _reads(self, series):
        return series.quantity in self.quantities

    def _read(self, sizes, values):
        return values


class _Gain(_Sensor):
    def _read(self, sizes, values):
        return values * (1.0 + np.asarray(sizes["gain"]))[:, None]


class _Delay(_Sensor):
    """In seconds: a line, a filter or a trigger knows nothing of the heart rate."""

    turning = True

    def _reads(self, series):
        return series.statistic == "waveform" and super()._reads(series)

    def late(self, place, sizes, series):
        read = self._reads(series) and series.location == place
        return np.asarray(sizes["delay"]) if read else np.zeros(1)


class PressureOffset(_Sensor):
    """Zero of a pressure transducer off (drift, height)."""

    name = "pressure_offset"
    formula = "P_read = P + b"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure off by a constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean pressure of the series"),)

    def observe(self, place, sizes, series, predicted):
        found = list(predicted)
        for quantity in self.quantities:
            mine = [i for i, s in enumerate(series) if s.quantity == quantity and self._covers(place, s.location)]
            if mine:
                scale = np.mean([predicted[i].mean(axis=1) for i in mine], axis=0)
                for i in mine:
                    found[i] = predicted[i] + (np.asarray(sizes["offset"]) * scale)[:, None]
        return found

    def _covers(self, place, location):
        return location == place


class SharedOffset(PressureOffset):
    """Zero of several pressures off alike: a wire that has drifted and is drawn from place to place, or one height of
    all transducers.

    Places: every pressure but the root's, and every pressure; of the second an FFR, ratio of two pressures that are
    both off, changes by b (1 - FFR) over the root's pressure.
    """

    name = "shared_offset"
    formula = "P_read = P + b at several places"
    source = "Cook et al., Circ. Cardiovasc. Interv. 9 (2016) e002988 (drift of pressure wires)"
    signature = "several pressures off by one constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean of these pressures"),)

    def places(self, anatomy, observed=()):
        read = [s for s in observed if self._reads(s)]
        kinds = {s.quantity for s in read}
        roots = (anatomy.inlet(root) for root in anatomy.roots)
        shared: dict[tuple, str] = {}
        for place in (EVERY_PRESSURE, *(f"{EVERY_PRESSURE} but {root}" for root in roots)):
            mine = frozenset(s.location for s in read if self._covers(place, s.location))
            # One place alone is its own sensor's; the same places under two names are one, but where a ratio tells. Of
            # an offset of all pressures ratios alone know nothing.
            if len(mine) > 1 and (place != EVERY_PRESSURE or "pressure" in kinds):
                shared.setdefault((mine, place == EVERY_PRESSURE and "ratio" in kinds), place)
        return list(shared.values())

    def observe(self, place, sizes, series, predicted):
        found = super().observe(place, sizes, series, predicted)
        if place == EVERY_PRESSURE:
            for i in (i for i, s in enumerate(series) if s.quantity == "ratio"):
                found[i] = predicted[i] + np.asarray(sizes["offset"])[:, None] * (1.0 - predicted[i])
        return found

    def _covers(self, place, location):
        return place != f"{EVERY_PRESSURE} but {location}"


class PressureGain(_Gain):
    """Gain of a pressure transducer off."""

    name = "pressure_gain"
    formula = "P_read = P (1 + g)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure off by a factor: its pulse grows with its mean"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.08, "gain less 1"),)


class PressureDelay(_Delay):
    """Pressure that arrives late, as through a fluid-filled line."""

    name = "pressure_delay"
    formula = "P_read(t) = P(t - d)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure waveform shifted in time in every condition"
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.03, "delay in seconds"),)


class FlowGain(_Gain):
    """Gain of a flow probe off."""

    name = "flow_gain"
    formula = "Q_read = Q (1 + g)"
    source = "Drost, Proc. San Diego Biomed. Symp. 17 (1978) 299 (transit-time flowmeter)"
    signature = "one flow off by a factor in every phase and condition"
    quantities = ("flow",)
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.15, "gain less 1"),)


class FlowDelay(_Delay):
    """Flow that is read late, as through a probe's filter or from images triggered on another signal."""

    name = "flow_delay"
    formula = "Q_read(t) = Q(t - d)"
    source = "Nichols et al., McDonald's Blood Flow in Arteries, 6th ed. (2011), measurement of flow"
    signature = "one flow waveform shifted in time in every condition"
    quantities = ("flow",)
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.03, "delay in seconds"),)


class TriggerDelay(_Delay):
    """Waveforms of several places that are late together: another trigger, or another start of the beat than modelled.

    Places: all waveforms, or all of one quantity, as from one imaging device beside a pressure that drives the model.
    """

    name = "trigger_delay"
    formula = "X_read(t) = X(t - d) for every waveform X of one device"
    source = "Nichols et al., McDonald's Blood Flow in Arteries, 6th ed. (2011), measurement of flow"
    signature = "several waveforms shifted in time alike in every condition"
    parameters = (Parameter("delay", "s", "normal", 0.0, 0.1, "delay in seconds"),)
    quantities_of: ClassVar = {
        "every waveform": ("pressure", "flow", "volume"),
        EVERY_PRESSURE: ("pressure",),
        "every flow": ("flow",),
    }

    def places(self, anatomy, observed=()):
        triggered: dict[tuple, str] = {}
        for place in self.quantities_of:
            shifted = {(s.quantity, s.location) for s in observed if self._triggers(place, s)}
            # One waveform alone is its own sensor's; the same waveforms under two names are one place.
            if len(shifted) > 1:
                triggered[tuple(sorted(shifted))] = place
        return list(triggered.values())

    def late(self, place, sizes, series):
        return np.asarray(sizes["delay"]) if self._triggers(place, series) else np.zeros(1)

    def _triggers(self, place, series):
        return series.statistic == "waveform" and series.quantity in self.quantities_of[place]
