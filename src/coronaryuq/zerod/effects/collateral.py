"""Collateral vessel between two territories."""

from itertools import combinations

from coronaryuq.zerod.effects.base import Effect, Parameter
from coronaryuq.zerod.effects.grafting import add_vessel, attach, open_end, opened


class Collateral(Effect):
    """A vessel that joins the ends of two outlet vessels, so that the better fed one supplies the other's bed."""

    name = "collateral"
    formula = "Q_col = (P_a - P_b) / R_col between the ends of two outlet vessels"
    source = "Pijls et al., J. Am. Coll. Cardiol. 25 (1995) 1522"
    signature = "two territories' pressures drawn together; one artery carries more than its bed, the other less"
    native = "a BloodVessel between two added NORMAL_JUNCTIONs"
    grafted = True
    parameters = (
        Parameter("conductance", "1", "lognormal", 0.3, 1.2, "conductance over that of the smaller of the two beds"),
    )

    def places(self, anatomy, observed=()):
        ends = [anatomy.beds[bed] for bed in anatomy.beds]
        return [f"{a}~{b}" for a, b in combinations(ends, 2)]

    def insert(self, network, place, anatomy):
        source, sink = place.split("~")
        network, upper, _ = open_end(network, source, "col")
        network, lower, _ = open_end(network, sink, "col")
        weak = 1e9 * anatomy.pressure / min(anatomy.flow_scale(source), anatomy.flow_scale(sink))
        number = add_vessel(network, self._vessel(place), {"R_poiseuille": weak})
        attach(network, upper, "outlet", number)
        attach(network, lower, "inlet", number)
        return network

    def aliases(self, place, anatomy):
        one, other = place.split("~")
        return opened(anatomy, one, "col") | opened(anatomy, other, "col")

    def changes(self, network, place, sizes, anatomy, condition):
        return {f"{self._vessel(place)}.R_poiseuille": self._resistance(place, sizes["conductance"], anatomy)}

    def physical(self, place, sizes, anatomy):
        return {"resistance of the collateral": self._resistance(place, sizes["conductance"], anatomy)}

    @staticmethod
    def _vessel(place):
        return "collateral_" + place.replace("~", "_")

    @staticmethod
    def _resistance(place, conductance, anatomy):
        source, sink = place.split("~")
        smaller = min(anatomy.flow_scale(source), anatomy.flow_scale(sink))
        return anatomy.pressure / (conductance * smaller)
