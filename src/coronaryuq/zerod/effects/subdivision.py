"""Vessels as chains of parts: what a lumped vessel lacks that stores and accelerates its blood in one place."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import grafted_name, put_behind

PARTS = 8
"""Parts of a vessel. The error of a lumped one is of first order in its length, so that an eighth of it is left."""
ELEMENTS = ("R_poiseuille", "L", "C", "stenosis_coefficient")


class Subdivision(Effect):
    """Waves along a vessel: it becomes a chain of equal parts, each with a share of its values.

    A vessel stores blood along its length, and a pulse takes time to travel through it. It is not in the library,
    because networks are lumped by choice: a search takes it as an error that any prediction has. Places: vessels that
    store blood.

    Formula: R_i = s R / n, L_i = s L / n, C_i = s C / n in all parts but the first, which has what is left
    """

    name = "subdivision"
    grafted = True
    nameable = False
    parameters = (Parameter("share", "1", "normal", 0.0, 1.0, "0 as in the model, 1 for equal parts"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        vessels = anatomy.vessels.items()
        return [name for name, vessel in vessels if vessel["zero_d_element_values"].get("C", 0.0) > 0.0]

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        network, last = network.deep_copy(), place
        for stem in _stems(place):
            last = put_behind(network, last, stem)
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        end, last = anatomy.downstream[place], grafted_name(anatomy.network, _stems(place)[-1])
        return {f"{place}:{end}": f"{last}:{end}"}

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        values, share = network.vessel(place)["zero_d_element_values"], np.asarray(sizes["share"], dtype=float)
        parts = [grafted_name(network, stem) for stem in _stems(place)]
        changes = {}
        for name in ELEMENTS:
            if value := values.get(name, 0.0):
                changes[f"{place}.{name}"] = value * (1.0 - share * len(parts) / PARTS)
                changes |= {f"{part}.{name}": value * share / PARTS for part in parts}
        return changes


def _stems(vessel: str) -> list[str]:
    """Return the stems of the parts that are added behind the first."""
    return [f"{vessel}_part_{number}" for number in range(2, PARTS + 1)]
