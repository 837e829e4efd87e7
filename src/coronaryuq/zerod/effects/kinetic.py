"""Kinetic losses at bifurcations and ostia."""

from collections.abc import Sequence

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Parameter, Series
from coronaryuq.zerod.effects.quadratic import QuadraticLoss

LOSS = Parameter("loss", "1", "lognormal", 0.05, 1.2, "fraction of the mean pressure lost in each vessel at mean flow")


class BifurcationLoss(QuadraticLoss):
    """Loss of kinetic energy into all daughter vessels of one bifurcation."""

    name = "bifurcation_loss"
    formula = "dP_i = K rho Q_i |Q_i| / (2 A_i^2) in every daughter, A_i ~ Q_i"
    source = "Mynard & Valen-Sendstad, Int. J. Numer. Meth. Biomed. Eng. 31 (2015) e02717"
    signature = "quadratic pressure drop in all daughters of a bifurcation, none in the parent"
    parameters = (LOSS,)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        inside = set(anatomy.coronary_vessels)
        return [name for name in anatomy.coronary_vessels if len(inside.intersection(anatomy.children(name))) > 1]

    def vessels(self, place: str, anatomy: Anatomy) -> list[str]:
        return anatomy.children(place)


class OstialLoss(QuadraticLoss):
    """Loss of kinetic energy at a coronary ostium; its formula is that of a stenosis of the first vessel."""

    name = "ostial_loss"
    formula = "dP = K rho Q |Q| / (2 A^2) at the ostium"
    source = "Idelchik, Handbook of Hydraulic Resistance (3rd ed., 1994), chapter 3: entrance losses"
    signature = "quadratic pressure drop in everything downstream of one ostium"
    parameters = (LOSS,)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.ostia
