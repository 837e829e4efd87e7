"""Outlets exchanged when the network was made: a wiring error of the model, not an effect in the patient."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Parameter, Series, Values
from coronaryuq.zerod.effects.wiring_error import WiringError


class ExchangedOutlets(WiringError):
    """Two beds connected to each other's vessels."""

    name = "exchanged_outlets"
    formula = "x_a -> x_a (x_b / x_a)^s and x_b -> x_b (x_a / x_b)^s for every positive value x that both beds have"
    source = "error in the names or the order of the outlet table"
    signature = (
        "resistance and stiffness of one outlet too high by the factor by which the other's are too low, in every "
        "condition"
    )
    native = "the values of the two boundary conditions"
    parameters = (Parameter("share", "1", "lognormal", 1.0, 0.15, "fraction of the exchange, 1 if it is complete"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [f"{a}~{b}" for a, b in combinations(anatomy.beds, 2) if _ratios(anatomy.network, a, b)]

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        first, second = place.split("~")
        share, changes = np.asarray(sizes["share"], dtype=float), {}
        for name, ratio in _ratios(network, first, second).items():
            changes[f"{first}.{name}"] = network.bed_values(first)[name] * ratio**share
            changes[f"{second}.{name}"] = network.bed_values(second)[name] * ratio**-share
        return changes

    def statement(self, place: str) -> str:
        return f"the outlets {' and '.join(place.split('~'))} are exchanged"

    def corrected(self, network: Network, place: str) -> tuple[Network, dict[str, str]]:
        first, second = place.split("~")
        network = network.deep_copy()
        one, other = network.bed_values(first), network.bed_values(second)
        for name in _ratios(network, first, second):
            one[name], other[name] = other[name], one[name]
        return network, {}


def _ratios(network: Network, first: str, second: str) -> dict[str, float]:
    """Return the ratio, second over first, of every positive value that both beds have and that differs."""
    one, other = network.bed_values(first), network.bed_values(second)
    both = [name for name in one if name in other and _positive(one[name]) and _positive(other[name])]
    return {name: other[name] / one[name] for name in both if other[name] != one[name]}


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0
