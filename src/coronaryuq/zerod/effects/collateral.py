"""Collateral vessel between two territories."""

from collections.abc import Sequence
from itertools import combinations

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import (
    DISTAL,
    add_vessel,
    attach,
    grafted_name,
    locations_renamed,
    open_end,
)


class Collateral(Effect):
    """Collateral vessel between the ends of two outlet vessels, through which one supplies the bed of the other."""

    name = "collateral"
    formula = "Q_col = (P_a - P_b) / R_col between the ends of two outlet vessels"
    source = "Pijls et al., J. Am. Coll. Cardiol. 25 (1995) 1522"
    signature = "pressures of two territories drawn together; one artery carries more flow than its bed, the other less"
    native = "a BloodVessel between two added NORMAL_JUNCTIONs"
    grafted = True
    parameters = (Parameter("conductance", "1", "lognormal", 0.3, 1.2, "conductance over that of the smaller bed"),)
    tag, added = "col", "collateral"
    """Suffix of the stubs to the beds, and prefix of the added vessel."""

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [f"{a}~{b}" for a, b in combinations(anatomy.beds.values(), 2)]

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        source, sink = place.split("~")
        network, upper, _ = open_end(network, source, self.tag)
        network, lower, _ = open_end(network, sink, self.tag)
        weak = 1e9 * anatomy.pressure / min(anatomy.flow_scale(source), anatomy.flow_scale(sink))
        number = add_vessel(network, f"{self.added}~{place}", {"R_poiseuille": weak})
        attach(network, upper, "outlet", number)
        attach(network, lower, "inlet", number)
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        source, sink = place.split("~")
        return locations_renamed(anatomy, source, self.tag) | locations_renamed(anatomy, sink, self.tag)

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        vessel = grafted_name(network, f"{self.added}~{place}")
        return {f"{vessel}.R_poiseuille": self._resistance(place, sizes["conductance"], anatomy)}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"resistance of the collateral": self._resistance(place, sizes["conductance"], anatomy)}

    @staticmethod
    def _resistance(place: str, conductance: Number, anatomy: Anatomy) -> Number:
        source, sink = place.split("~")
        smaller = min(anatomy.flow_scale(source), anatomy.flow_scale(sink))
        return anatomy.pressure / (conductance * smaller)


class DistalCollateral(Collateral):
    """Collateral vessel between two beds, beyond the flow probes at the ends of their vessels.

    The probes measure what the two vessels carry, not what the beds receive. It resembles beds whose resistances differ
    from the model's, where pressures are alike.
    """

    name = "distal_collateral"
    formula = "Q_col = (P_a - P_b) / R_col beyond the probes at the ends of two outlet vessels"
    signature = "one measured flow above what its bed receives and one below; pressures of the two drawn together"
    beyond_probes = True
    tag, added = DISTAL, "distal_collateral"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        probes = {s.location for s in observed if s.quantity == "flow"}
        pairs = combinations(anatomy.beds.values(), 2)
        return [f"{a}~{b}" for a, b in pairs if probes & {anatomy.outlet(a), anatomy.outlet(b)}]
