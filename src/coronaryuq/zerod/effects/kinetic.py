"""Kinetic losses where flow turns and divides."""

from coronaryuq.zerod.effects.base import Parameter
from coronaryuq.zerod.effects.quadratic import QuadraticLoss

LOSS = Parameter(
    "loss", "1", "lognormal", 0.05, 1.2, "share of the mean pressure lost in each vessel at the model's mean flow"
)


class BifurcationLoss(QuadraticLoss):
    """Loss of kinetic energy into all daughters of one bifurcation."""

    name = "bifurcation_loss"
    formula = "dP_i = K rho Q_i |Q_i| / (2 A_i^2) in every daughter, A_i ~ Q_i"
    source = "Mynard & Valen-Sendstad, Int. J. Numer. Meth. Biomed. Eng. 31 (2015) e02717"
    signature = "quadratic drop of pressure common to all daughters of a bifurcation, none in the parent"
    parameters = (LOSS,)

    def places(self, anatomy, observed=()):
        inside = set(anatomy.coronary_vessels)
        return [name for name in anatomy.coronary_vessels if len(inside.intersection(anatomy.children[name])) > 1]

    def vessels(self, place, anatomy):
        return anatomy.children[place]


class OstialLoss(QuadraticLoss):
    """Loss of kinetic energy at a coronary ostium: by its formula a stenosis of the first vessel."""

    name = "ostial_loss"
    formula = "dP = K rho Q |Q| / (2 A^2) at the ostium"
    source = "Idelchik, Handbook of Hydraulic Resistance (3rd ed., 1994), chapter 3: entrance losses"
    signature = "quadratic drop of pressure in everything that one ostium feeds"
    parameters = (LOSS,)

    def places(self, anatomy, observed=()):
        return anatomy.ostia
