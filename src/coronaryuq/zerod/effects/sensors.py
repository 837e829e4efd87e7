"""Errors of the readings of pressure and flow sensors: offset, drift, gain, saturation."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from coronaryuq.core import units
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter, Series, Values

NATIVE = "acts on predictions; the network stays the same"
EVERY_PRESSURE = "every pressure"
CLINICAL = {"pressure": ("mmHg", units.MMHG), "flow": ("mL/min", units.ML_PER_MIN)}
"""Quantity → unit in which an offset is reported, and its size in CGS."""


def scale_of(series: Series) -> float:
    """Return the usual size of what a sensor reads, CGS; raise `ValueError` if it is not known."""
    if series.scale is None:
        raise ValueError(f"the scale of {series.quantity} at {series.location} is not known")
    return series.scale


class Sensor(Effect):
    """Base class of the errors of one sensor."""

    side = "measurement"
    native = NATIVE
    quantities: ClassVar[tuple[str, ...]] = ("pressure", "ratio")
    """Quantities that the sensor reads; of a ratio, its numerator."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return list(dict.fromkeys(s.location for s in observed if self._reads(s)))

    def _reads(self, series: Series) -> bool:
        return series.quantity in self.quantities


class _Gain(Sensor):
    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        factor = (1.0 + np.asarray(sizes["gain"]))[:, None]
        return [
            values * factor if self._reads(s) and s.location == place else values
            for s, values in zip(series, predicted, strict=True)
        ]

    def describe(self, parameter: Parameter, size: float, anatomy: Anatomy) -> tuple[str, float]:
        reversed_ = " (below -1, as here: the sign is reversed)" * (size < -1.0)
        return f"{parameter.meaning}{reversed_}", size


class Offset(Sensor):
    """Error that does not depend on the reading: a size times the scale of the sensor's readings."""

    meaning = "offset"

    def clinical(self, place: str, series: Sequence[Series]) -> tuple[str, float] | None:
        """Return what the error is in words, and what a size of 1 is in that unit; None if only ratios are affected."""
        quantity = self.quantities[0]
        name, unit = CLINICAL[quantity]
        scales = [scale_of(s) for s in series if s.quantity == quantity and self._covers(place, s.location)]
        return (f"{self.meaning} in {name}", scales[0] / unit) if scales else None

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        (size,) = sizes.values()
        weights = self._weights(series)
        return [
            values + weights[s.condition] * scale_of(s) * np.asarray(size)[:, None]
            if s.quantity in self.quantities and self._covers(place, s.location)
            else values
            for s, values in zip(series, predicted, strict=True)
        ]

    def _covers(self, place: str, location: str) -> bool:
        return location == place

    def _weights(self, series: Sequence[Series]) -> dict[str, float]:
        """Return condition → fraction of the error that is present."""
        return {s.condition: 1.0 for s in series}


class _Drift(Offset):
    """Offset that grows from zero in the first condition by the same amount from each condition to the next.

    The conditions are taken to have been recorded in the order of the conditions file, at even intervals, the sensor
    zeroed before the first.
    """

    meaning = "offset in the last condition"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return super().places(anatomy, observed) if len({s.condition for s in observed}) > 1 else []

    def _weights(self, series: Sequence[Series]) -> dict[str, float]:
        order = list(dict.fromkeys(s.condition for s in series))
        return {condition: number / max(len(order) - 1, 1) for number, condition in enumerate(order)}


class PressureOffset(Offset):
    """Zero error of a pressure transducer (drift, height)."""

    name = "pressure_offset"
    formula = "P_read = P + b"
    source = "Gardner, Anesthesiology 54 (1981) 227"
    signature = "one pressure wrong by a constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean pressure at the root"),)


class SharedOffset(Offset):
    """Zero error common to several pressures, as of a drifting wire moved from place to place.

    Places: every pressure except the root's, and every pressure. In the second case an FFR, the ratio of two pressures
    with the error, changes by b (1 - FFR) over the root pressure.
    """

    name = "shared_offset"
    formula = "P_read = P + b at several places"
    source = "Cook et al., Circ. Cardiovasc. Interv. 9 (2016) e002988 (drift of pressure wires)"
    signature = "several pressures wrong by one constant in every phase and condition"
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.08, "offset over the mean pressure at the root"),)

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


class FlowGain(_Gain):
    """Gain error of a flow probe."""

    name = "flow_gain"
    formula = "Q_read = Q (1 + g)"
    source = "Drost, Proc. San Diego Biomed. Symp. 17 (1978) 299 (transit-time flowmeter)"
    signature = "one flow wrong by a factor in every phase and condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("gain", "1", "normal", 0.0, 0.15, "gain minus 1"),)


class PressureDrift(_Drift):
    """Zero of a pressure transducer that drifts from one condition to the next."""

    name = "pressure_drift"
    formula = "P_read = P + b k / (n - 1) in the k-th of n conditions, k from 0"
    source = "Cook et al., Circ. Cardiovasc. Interv. 9 (2016) e002988 (drift of pressure wires)"
    signature = "one pressure wrong by a constant in every phase, more from one recorded condition to the next"
    parameters = (Parameter("drift", "1", "normal", 0.0, 0.08, "offset in the last condition over that at the root"),)


class FlowOffset(Offset):
    """Zero error of a flow probe."""

    name = "flow_offset"
    formula = "Q_read = Q + b"
    source = "Wyatt, Med. Biol. Eng. 4 (1966) 17 (baseline of electromagnetic flowmeters)"
    signature = "one flow wrong by the same amount in every phase and condition, so mostly where it is low"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("offset", "1", "normal", 0.0, 0.1, "offset over the mean size of this flow in the model"),)


class FlowDrift(_Drift):
    """Zero of a flow probe that drifts from one condition to the next."""

    name = "flow_drift"
    formula = "Q_read = Q + b k / (n - 1) in the k-th of n conditions, k from 0"
    source = FlowOffset.source
    signature = "one flow wrong by the same amount in every phase, more from one recorded condition to the next"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("drift", "1", "normal", 0.0, 0.1, "offset in the last condition over that of the flow"),)


class FlowSaturation(Sensor):
    """Flow meter that reads too little at high flow, forward and backward."""

    name = "flow_saturation"
    formula = "Q_read = Q / (1 + a |Q| / Q_0), Q_0 the mean flow of the vessel in the model"
    source = "own derivation: first-order compression of an amplifier, Q (1 - a |Q| / Q_0) for small a"
    signature = "peaks of one flow flattened; its mean too low, increasingly so in hyperaemia"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (
        Parameter("saturation", "1", "lognormal", 0.05, 0.8, "fraction of the reading lost at the model's mean flow"),
    )

    def read(
        self,
        place: str,
        sizes: Values,
        series: Series,
        wave: np.ndarray,
        other: np.ndarray | None,
        anatomy: Anatomy,
    ) -> np.ndarray:
        if not self._reads(series) or series.location != place:
            return wave
        scale = anatomy.flow_scale(anatomy.vessel_at(place) or "")
        return wave / (1.0 + np.asarray(sizes["saturation"])[:, None] * np.abs(wave) / scale)
