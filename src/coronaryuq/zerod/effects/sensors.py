"""Errors of sensors: offset, gain and delay of pressure, gain of flow."""

import numpy as np

from coronaryuq.zerod.effects.base import Effect, Parameter

NATIVE = "measuring side: acts on predictions at one location, the network stays as it is"


class _Sensor(Effect):
    side = "measurement"
    native = NATIVE
    quantity = "pressure"

    def places(self, anatomy, observed=()):
        return list(dict.fromkeys(s.location for s in observed if s.quantity == self.quantity))

    def observe(self, place, sizes, series, predicted):
        return [
            self._read(sizes, s, values) if (s.quantity, s.location) == (self.quantity, place) else values
            for s, values in zip(series, predicted, strict=True)
        ]


class PressureOffset(_Sensor):
    """Zero of a pressure transducer off (drift, height)."""

    name = "pressure_offset"
    formula = "P_read = P + b"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure off by a constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean pressure of the series"),)

    def observe(self, place, sizes, series, predicted):
        mine = [i for i, s in enumerate(series) if (s.quantity, s.location) == (self.quantity, place)]
        found = list(predicted)
        if mine:
            scale = np.mean([predicted[i].mean(axis=1) for i in mine], axis=0)
            for i in mine:
                found[i] = predicted[i] + (np.asarray(sizes["offset"]) * scale)[:, None]
        return found


class PressureGain(_Sensor):
    """Gain of a pressure transducer off."""

    name = "pressure_gain"
    formula = "P_read = P (1 + g)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure off by a factor: its pulse grows with its mean"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.08, "gain less 1"),)

    def _read(self, sizes, series, values):
        return values * (1.0 + np.asarray(sizes["gain"]))[:, None]


class PressureDelay(_Sensor):
    """Pressure that arrives late, as through a fluid-filled line."""

    name = "pressure_delay"
    formula = "P_read(t) = P(t - d T)"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure waveform shifted in time in every condition"
    parameters = (Parameter("delay", "cycle", "normal", 0.0, 0.03, "delay over the period"),)

    def places(self, anatomy, observed=()):
        return list(
            dict.fromkeys(s.location for s in observed if s.quantity == self.quantity and s.statistic == "waveform")
        )

    def _read(self, sizes, series, values):
        if series.statistic != "waveform":
            return values
        late = (series.time[None, :] - np.asarray(sizes["delay"])[:, None] * series.period) % series.period
        return np.array(
            [np.interp(t, series.time, row, period=series.period) for t, row in zip(late, values, strict=True)]
        )


class FlowGain(_Sensor):
    """Gain of a flow probe off."""

    name = "flow_gain"
    formula = "Q_read = Q (1 + g)"
    source = "Drost, Proc. San Diego Biomed. Symp. 17 (1978) 299 (transit-time flowmeter)"
    signature = "one flow off by a factor in every phase and condition"
    quantity = "flow"
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.15, "gain less 1"),)

    def _read(self, sizes, series, values):
        return values * (1.0 + np.asarray(sizes["gain"]))[:, None]
