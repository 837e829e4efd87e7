"""Errors of the perfusion map: extraction of tracer, territories out of place."""

import numpy as np

from coronaryuq.zerod.effects.base import Effect, Parameter


class RenkinCrone(Effect):
    """Myocardial blood flow underestimated at high flow, because less tracer is extracted."""

    name = "mbf_underestimation"
    formula = "MBF = F (1 - exp(-PS / F)) / (1 - exp(-PS / F_0)), PS = F_0 / s, F_0 the least flow measured"
    source = "Renkin, Am. J. Physiol. 197 (1959) 1205; Crone, Acta Physiol. Scand. 58 (1963) 292"
    signature = "perfusion right at rest and too low in hyperaemia, the more the higher the flow"
    native = "measuring side: acts on predicted perfusion, the network stays as it is"
    parameters = (
        Parameter(
            "saturation", "1", "lognormal", 0.3, 0.8, "least measured flow over the permeability-surface product"
        ),
    )
    side = "measurement"

    def places(self, anatomy, observed=()):
        territories = {s.location for s in observed if s.quantity == "perfusion"}
        return ["perfusion map"] if territories and len({s.condition for s in observed}) > 1 else []

    def observe(self, place, sizes, series, predicted):
        chosen = [i for i, s in enumerate(series) if s.quantity == "perfusion"]
        if not chosen:
            return predicted
        least = np.min([np.abs(predicted[i]).min(axis=1) for i in chosen], axis=0)
        extraction = np.asarray(sizes["saturation"])
        found = list(predicted)
        for i in chosen:
            relative = np.maximum(np.abs(predicted[i]) / least[:, None], 1e-12)
            seen = -np.expm1(-1.0 / (extraction[:, None] * relative)) / -np.expm1(-1.0 / extraction[:, None])
            found[i] = predicted[i] * seen
        return found


class ShiftedTerritories(Effect):
    """Perfusion of one territory counted in part with a neighbour's."""

    name = "shifted_territory"
    formula = "MBF_a = (1 - s) F_a + s F_b, s at most 1"
    source = "territories by nearest outlet and their noise: Menon et al. (2024)"
    signature = (
        "one territory's perfusion drawn towards another's in every condition, pressures and epicardial flows right"
    )
    native = "measuring side: acts on predicted perfusion, the network stays as it is"
    parameters = (Parameter("share", "1", "lognormal", 0.2, 0.7, "share of a territory that belongs to the other"),)
    side = "measurement"

    def places(self, anatomy, observed=()):
        territories = sorted({s.location for s in observed if s.quantity == "perfusion"})
        return [f"{a}<{b}" for a in territories for b in territories if a != b]

    def observe(self, place, sizes, series, predicted):
        taker, giver = place.split("<")
        share = np.minimum(np.asarray(sizes["share"]), 1.0)[:, None]
        index = {(s.condition, s.location, s.statistic): i for i, s in enumerate(series) if s.quantity == "perfusion"}
        found = list(predicted)
        for (condition, location, statistic), i in index.items():
            other = index.get((condition, giver, statistic))
            if location == taker and other is not None:
                found[i] = (1.0 - share) * predicted[i] + share * predicted[other]
        return found


class RotatedTerritories(Effect):
    """The whole map of territories rotated: every territory counted in part with the next."""

    name = "rotated_territories"
    formula = (
        "MBF_i = (1 - |s|) F_i + |s| F_(i+1) (s > 0) or F_(i-1) (s < 0), territories in the order of the measurements"
    )
    source = "AHA 17-segment convention: Cerqueira et al., Circulation 105 (2002) 539"
    signature = "every territory's perfusion drawn towards its neighbour's, in every condition alike"
    native = "measuring side: acts on predicted perfusion, the network stays as it is"
    parameters = (Parameter("share", "1", "normal", 0.0, 0.3, "rotation over a territory's width"),)
    side = "measurement"

    def places(self, anatomy, observed=()):
        return ["perfusion map"] if len({s.location for s in observed if s.quantity == "perfusion"}) > 2 else []

    def observe(self, place, sizes, series, predicted):
        territories = list(dict.fromkeys(s.location for s in series if s.quantity == "perfusion"))
        index = {(s.condition, s.location, s.statistic): i for i, s in enumerate(series) if s.quantity == "perfusion"}
        share = np.clip(np.asarray(sizes["share"]), -1.0, 1.0)[:, None]
        found = list(predicted)
        for (condition, location, statistic), i in index.items():
            position = territories.index(location)
            after, before = (
                index.get((condition, territories[(position + step) % len(territories)], statistic), i)
                for step in (1, -1)
            )
            neighbour = np.where(share > 0, predicted[after], predicted[before])
            found[i] = (1.0 - np.abs(share)) * predicted[i] + np.abs(share) * neighbour
        return found
