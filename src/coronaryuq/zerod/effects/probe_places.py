"""Probes that read other places than stated: misplaced, with channels exchanged, or with a part of another flow."""

from abc import abstractmethod
from collections.abc import Sequence
from itertools import combinations, permutations
from typing import ClassVar

import numpy as np

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Channel, Parameter, Series, Values
from coronaryuq.zerod.effects.sensors import Sensor

TOWARDS, AND, WITH = " towards ", " and ", " with "


class _ReadsElsewhere(Sensor):
    """Reading that contains a share of the waveform at another place."""

    def read(
        self,
        place: str,
        sizes: Values,
        series: Series,
        wave: np.ndarray,
        other: np.ndarray | None,
        anatomy: Anatomy,
    ) -> np.ndarray:
        if other is None:
            return wave
        share = np.asarray(sizes["share"], dtype=float)[:, None]
        return self.kept(share) * wave + share * other

    def kept(self, share: np.ndarray) -> np.ndarray | float:
        """Return the fraction of the waveform at the stated place that is read beside a share of the other one."""
        return 1.0 - share


class _Misplaced(_ReadsElsewhere):
    """Probe away from its stated place. Places: each sensor, with each vessel that meets its own there."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [
            f"{location}{TOWARDS}{vessel}"
            for location in super().places(anatomy, observed)
            for vessel in self._neighbours(location, anatomy)
        ]

    def elsewhere(self, place: str, series: Series, anatomy: Anatomy) -> Channel | None:
        location, _, vessel = place.partition(TOWARDS)
        if series.location != location or not self._reads(series):
            return None
        return series.quantity, self._neighbours(location, anatomy)[vessel]

    @abstractmethod
    def _neighbours(self, location: str, anatomy: Anatomy) -> dict[str, str]:
        """Return neighbouring vessel → the location there that the probe would read."""


class MisplacedPressure(_Misplaced):
    """Pressure read in a neighbouring vessel, or nearer to the other end of its own."""

    name = "misplaced_pressure"
    formula = "P_read = (1 - s) P + s P_far, P_far at the far end of that vessel"
    source = "Kern et al., Circulation 114 (2006) 1321 (position of pressure wires)"
    signature = "one pressure between that of its place and that of a neighbouring place, in every phase and condition"
    parameters = (Parameter("share", "1", "lognormal", 0.5, 0.7, "distance as a fraction of that vessel's loss"),)

    def _neighbours(self, location: str, anatomy: Anatomy) -> dict[str, str]:
        vessel = anatomy.vessel_at(location)
        if vessel is None:
            return {}
        if location == anatomy.outlet(vessel):
            return {vessel: anatomy.inlet(vessel)} | {name: anatomy.outlet(name) for name in anatomy.children(vessel)}
        parents = anatomy.parents(vessel)
        siblings = [name for parent in parents for name in anatomy.children(parent)]
        found = {name: anatomy.outlet(name) for name in (vessel, *siblings)}
        return found | {name: anatomy.inlet(name) for name in parents}


class MisplacedFlow(_Misplaced):
    """Flow read, in part or in full, in a neighbouring vessel."""

    name = "misplaced_flow"
    formula = "Q_read = (1 - s) Q + s Q_neighbour"
    source = "Gatehouse et al., J. Cardiovasc. Magn. Reson. 12 (2010) 5 (planes and vessels in flow measurement)"
    signature = "one flow between that of its vessel and that of a neighbouring one, in every phase and condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("share", "1", "lognormal", 0.5, 0.7, "fraction of the reading from that vessel"),)

    def _neighbours(self, location: str, anatomy: Anatomy) -> dict[str, str]:
        vessel = anatomy.vessel_at(location)
        if vessel is None:
            return {}
        parents = anatomy.parents(vessel)
        siblings = [name for parent in parents for name in anatomy.children(parent) if name != vessel]
        found = {name: anatomy.inlet(name) for name in (*siblings, *anatomy.children(vessel))}
        return {name: anatomy.outlet(name) for name in parents} | found


class _Exchanged(_ReadsElsewhere):
    """Two channels of one quantity connected to each other's sensors. Places: each pair."""

    exchanges = True

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [AND.join(pair) for pair in combinations(super().places(anatomy, observed), 2)]

    def elsewhere(self, place: str, series: Series, anatomy: Anatomy) -> Channel | None:
        pair = place.split(AND)
        if series.location not in pair or not self._reads(series):
            return None
        return series.quantity, pair[1 - pair.index(series.location)]


SHARE = Parameter("share", "1", "lognormal", 1.0, 0.05, "fraction of the exchange, 1 if the two channels are exchanged")


class ExchangedPressures(_Exchanged):
    """Two pressure channels exchanged when the measurements were recorded or named."""

    name = "exchanged_pressures"
    formula = "P_a,read = (1 - s) P_a + s P_b and P_b,read = (1 - s) P_b + s P_a; s = 1 unless the exchange is partial"
    source = "error in the connection or the names of channels"
    signature = "each of two pressures is predicted by the other, in every phase and condition"
    quantities: ClassVar[tuple[str, ...]] = ("pressure",)
    parameters = (SHARE,)


class ExchangedFlows(_Exchanged):
    """Two flow channels exchanged when the measurements were recorded or named."""

    name = "exchanged_flows"
    formula = "Q_a,read = (1 - s) Q_a + s Q_b and Q_b,read = (1 - s) Q_b + s Q_a; s = 1 unless the exchange is partial"
    source = "error in the connection or the names of channels"
    signature = "each of two flows is predicted by the other, in every phase and condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (SHARE,)


class FlowCrosstalk(_ReadsElsewhere):
    """Flow to which a part of another one is added: crosstalk, or a sample volume that includes another vessel.

    Places: each ordered pair of sensors, FLOW with OTHER.
    """

    name = "flow_crosstalk"
    formula = "Q_read = Q + s Q_other"
    source = "Gatehouse et al., J. Cardiovasc. Magn. Reson. 12 (2010) 5 (planes and vessels in flow measurement)"
    signature = "one flow too large by a fraction of another one, in every phase and condition"
    quantities: ClassVar[tuple[str, ...]] = ("flow",)
    parameters = (Parameter("share", "1", "lognormal", 0.2, 0.7, "fraction of the other flow that is added"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [WITH.join(pair) for pair in permutations(super().places(anatomy, observed), 2)]

    def elsewhere(self, place: str, series: Series, anatomy: Anatomy) -> Channel | None:
        location, other = place.split(WITH)
        return (series.quantity, other) if series.location == location and self._reads(series) else None

    def kept(self, share: np.ndarray) -> np.ndarray | float:
        return 1.0
