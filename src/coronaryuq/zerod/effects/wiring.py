"""What is wrong with the model and not with the patient: outlets that were exchanged when the network was made."""

from itertools import combinations

import numpy as np

from coronaryuq.zerod.effects.base import Effect, Parameter, bed_values


class ExchangedOutlets(Effect):
    """Two beds that each feed from the other's vessel."""

    name = "exchanged_outlets"
    formula = "x_a -> x_a (x_b / x_a)^s and x_b -> x_b (x_a / x_b)^s for every positive number x that both beds have"
    source = "a mistake in the table of outlets, of names or of their order"
    signature = (
        "one outlet too tight and too stiff by what the other is too wide and too soft, in every condition alike"
    )
    native = "the values of the two boundary conditions"
    parameters = (Parameter("share", "1", "lognormal", 1.0, 0.15, "share of the exchange; 1 is all of it"),)
    nameable = False

    def places(self, anatomy, observed=()):
        return [f"{a}~{b}" for a, b in combinations(anatomy.beds, 2) if _ratios(anatomy.network, a, b)]

    def changes(self, network, place, sizes, anatomy, condition):
        one, other = place.split("~")
        share, found = np.asarray(sizes["share"], dtype=float), {}
        for name, ratio in _ratios(network, one, other).items():
            found[f"{one}.{name}"] = bed_values(network, one)[name] * ratio**share
            found[f"{other}.{name}"] = bed_values(network, other)[name] * ratio**-share
        return found


def _ratios(network: dict, one: str, other: str) -> dict[str, float]:
    """Of every positive number that both beds have and that differs: the other's over the one's."""
    ours, theirs = bed_values(network, one), bed_values(network, other)
    both = [name for name in ours if name in theirs and _positive(ours[name]) and _positive(theirs[name])]
    return {name: theirs[name] / ours[name] for name in both if theirs[name] != ours[name]}


def _positive(value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0
