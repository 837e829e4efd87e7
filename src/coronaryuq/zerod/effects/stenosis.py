"""Pressure loss of a stenosis: kinetic alone, and with the friction of its throat."""

from coronaryuq.zerod.effects.base import Parameter, vessel_values
from coronaryuq.zerod.effects.quadratic import QuadraticLoss


class QuadraticStenosis(QuadraticLoss):
    """Turbulent loss behind a narrowing, beyond the viscous one."""

    name = "quadratic_stenosis"
    formula = "dP = (R + S |Q|) Q, S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395; Pfaller et al., Int. J. Numer. Meth. Biomed. Eng. 38 (2022) e3639"
    signature = "distal pressure falls with the square of flow: far more in hyperaemia than at rest"

    def places(self, anatomy, observed=()):
        return anatomy.coronary_vessels


class StenosisWithFriction(QuadraticStenosis):
    """Both losses of Young and Tsai: the throat's friction and the turbulent loss behind it.

    Long or mild stenoses lose as much to friction as to turbulence, which one loss alone takes for a narrowing.
    """

    name = "stenosis_with_friction"
    formula = "dP = (R + R_t + S |Q|) Q, R_t = K_v mu / (2 pi r0^3), S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395"
    signature = (
        "distal pressure falls with flow and with its square: at rest already, and more than in proportion later"
    )
    native = f"R_poiseuille and {QuadraticLoss.native}"
    parameters = (
        # By the formula at a mean velocity of 15 cm/s: 0.1, 1.3 and 36 % with 45, 75 and 94 % of the area gone. Smaller
        # than turbulence alone: friction is a large part of the loss where a stenosis is mild.
        Parameter("loss", "1", "lognormal", 0.02, 1.5, "share of the mean pressure lost to turbulence at mean flow"),
        Parameter("friction", "1", "lognormal", 1.0, 1.0, "loss to friction over that to turbulence at mean flow"),
    )

    def changes(self, network, place, sizes, anatomy, condition):
        found = super().changes(network, place, sizes, anatomy, condition)
        for name in [key.removesuffix(".stenosis_coefficient") for key in found]:
            present = vessel_values(network, name).get("R_poiseuille", 0.0)
            found[f"{name}.R_poiseuille"] = present + self._friction(place, sizes, anatomy)
        return found

    def physical(self, place, sizes, anatomy):
        return super().physical(place, sizes, anatomy) | {"R_poiseuille added": self._friction(place, sizes, anatomy)}

    @staticmethod
    def _friction(place, sizes, anatomy):
        return sizes["friction"] * sizes["loss"] * anatomy.pressure / anatomy.flow_scale(place)
