"""Errors of the perfusion map: tracer extraction, misplaced territories."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.anatomy.vessel_names import natural_key
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter, Series, Values

NATIVE = "acts on predicted perfusion; the network stays the same"
MAP = "perfusion map"


class MapError(Effect):
    """Base class of the errors of the perfusion map."""

    side = "measurement"
    native = NATIVE


class MBFUnderestimation(MapError):
    """Myocardial blood flow underestimated at high flow, where less tracer is extracted."""

    name = "mbf_underestimation"
    formula = "MBF = F (1 - exp(-PS / F)) / (1 - exp(-PS / F_0)), PS = F_0 / s, F_0 the lowest measured flow"
    source = "Renkin, Am. J. Physiol. 197 (1959) 1205; Crone, Acta Physiol. Scand. 58 (1963) 292"
    signature = "perfusion correct at rest and too low in hyperaemia, increasingly so at high flow"
    across_conditions = True
    parameters = (
        Parameter(
            "saturation", "1", "lognormal", 0.3, 0.8, "lowest measured flow over the permeability-surface product"
        ),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [MAP] if len({s.condition for s in observed if s.quantity == "perfusion"}) > 1 else []

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        perfused = [i for i, s in enumerate(series) if s.quantity == "perfusion"]
        if not perfused:
            return predicted
        lowest = np.min([np.abs(predicted[i]).min(axis=1) for i in perfused], axis=0)
        saturation = np.asarray(sizes["saturation"])
        observed = list(predicted)
        for i in perfused:
            relative = np.maximum(np.abs(predicted[i]) / lowest[:, None], 1e-12)
            extraction = -np.expm1(-1.0 / (saturation[:, None] * relative)) / -np.expm1(-1.0 / saturation[:, None])
            observed[i] = predicted[i] * extraction
        return observed


class ShiftedTerritory(MapError):
    """Part of one territory attributed to another."""

    name = "shifted_territory"
    formula = "MBF_a = (1 - s) F_a + s F_b"
    source = "territories by nearest outlet and their noise: Menon et al. (2024)"
    signature = (
        "perfusion of one territory drawn towards that of another in every condition; pressures and epicardial flows "
        "correct"
    )
    parameters = (Parameter("share", "1", "lognormal", 0.2, 0.7, "fraction of a territory that belongs to the other"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        territories = sorted({s.location for s in observed if s.quantity == "perfusion"})
        return [f"{a}<{b}" for a in territories for b in territories if a != b]

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        taker, giver = place.split("<")
        share = np.asarray(sizes["share"])[:, None]
        index = {(s.condition, s.location, s.statistic): i for i, s in enumerate(series) if s.quantity == "perfusion"}
        observed = list(predicted)
        for (condition, location, statistic), i in index.items():
            other = index.get((condition, giver, statistic))
            if location == taker and other is not None:
                observed[i] = (1.0 - share) * predicted[i] + share * predicted[other]
        return observed


class RotatedTerritories(MapError):
    """Rotated map of territories: part of every territory attributed to the next."""

    name = "rotated_territories"
    formula = "MBF_i = (1 - |s|) F_i + |s| F_(i+1) (s > 0) or F_(i-1) (s < 0), territories in the order of their names"
    source = "AHA 17-segment convention: Cerqueira et al., Circulation 105 (2002) 539"
    signature = "perfusion of every territory drawn towards that of its neighbour, the same in every condition"
    changes_shape = True
    parameters = (Parameter("share", "1", "normal", 0.0, 0.3, "rotation over a territory's width"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [MAP] if len({s.location for s in observed if s.quantity == "perfusion"}) > 2 else []

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        territories = sorted({s.location for s in series if s.quantity == "perfusion"}, key=natural_key)
        index = {(s.condition, s.location, s.statistic): i for i, s in enumerate(series) if s.quantity == "perfusion"}
        share = np.asarray(sizes["share"])[:, None]
        observed = list(predicted)
        for (condition, location, statistic), i in index.items():
            position = territories.index(location)
            after, before = (
                index.get((condition, territories[(position + step) % len(territories)], statistic), i)
                for step in (1, -1)
            )
            neighbour = np.where(share > 0, predicted[after], predicted[before])
            observed[i] = (1.0 - np.abs(share)) * predicted[i] + np.abs(share) * neighbour
        return observed
