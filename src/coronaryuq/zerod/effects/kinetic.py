"""Kinetic losses where flow turns and divides."""

from coronaryuq.zerod.effects.base import Effect, Parameter, vessel_values


class BifurcationLoss(Effect):
    """Loss of kinetic energy into all daughters of one bifurcation."""

    name = "bifurcation_loss"
    formula = "dP_i = K rho Q_i |Q_i| / (2 A_i^2) in every daughter, A_i ~ Q_i"
    source = "Mynard & Valen-Sendstad, Int. J. Numer. Meth. Biomed. Eng. 31 (2015) e02717"
    signature = "quadratic drop of pressure common to all daughters of a bifurcation, none in the parent"
    native = "stenosis_coefficient of the daughters"
    parameters = (
        Parameter(
            "loss",
            "1",
            "lognormal",
            0.05,
            1.2,
            "share of the mean pressure lost in each daughter at the model's mean flow",
        ),
    )

    def places(self, anatomy, observed=()):
        inside = set(anatomy.coronary_vessels)
        return [name for name in anatomy.coronary_vessels if len(inside.intersection(anatomy.children[name])) > 1]

    def changes(self, network, place, sizes, anatomy, condition):
        found = {}
        for child in anatomy.children[place]:
            present = vessel_values(network, child).get("stenosis_coefficient", 0.0)
            found[f"{child}.stenosis_coefficient"] = present + self._coefficient(child, sizes["loss"], anatomy)
        return found

    def physical(self, place, sizes, anatomy):
        return {
            f"stenosis_coefficient added to {c}": self._coefficient(c, sizes["loss"], anatomy)
            for c in anatomy.children[place]
        }

    @staticmethod
    def _coefficient(vessel, loss, anatomy):
        return loss * anatomy.pressure / anatomy.flow_scale(vessel) ** 2


class OstialLoss(BifurcationLoss):
    """Loss of kinetic energy at a coronary ostium: by its formula a stenosis of the first vessel."""

    name = "ostial_loss"
    formula = "dP = K rho Q |Q| / (2 A^2) at the ostium"
    source = "Idelchik, Handbook of Hydraulic Resistance (3rd ed., 1994), chapter 3: entrance losses"
    signature = "quadratic drop of pressure in everything that one ostium feeds"
    native = "stenosis_coefficient of the first vessel"

    def places(self, anatomy, observed=()):
        return anatomy.ostia

    def changes(self, network, place, sizes, anatomy, condition):
        present = vessel_values(network, place).get("stenosis_coefficient", 0.0)
        return {f"{place}.stenosis_coefficient": present + self._coefficient(place, sizes["loss"], anatomy)}

    def physical(self, place, sizes, anatomy):
        return {f"stenosis_coefficient added to {place}": self._coefficient(place, sizes["loss"], anatomy)}
