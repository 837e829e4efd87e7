"""Quadratic pressure loss of a stenosis."""

from coronaryuq.zerod.effects.base import Effect, Parameter, vessel_values


class QuadraticStenosis(Effect):
    """Turbulent loss behind a narrowing, beyond the viscous one."""

    name = "quadratic_stenosis"
    formula = "dP = (R + S |Q|) Q, S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395; Pfaller et al., Int. J. Numer. Meth. Biomed. Eng. 38 (2022) e3639"
    signature = "distal pressure falls with the square of flow: far more in hyperaemia than at rest"
    native = "stenosis_coefficient of the vessel"
    parameters = (
        Parameter("loss", "1", "lognormal", 0.1, 1.2, "share of the mean pressure lost at the model's own mean flow"),
    )

    def places(self, anatomy, observed=()):
        return anatomy.coronary_vessels

    def changes(self, network, place, sizes, anatomy, condition):
        present = vessel_values(network, place).get("stenosis_coefficient", 0.0)
        return {f"{place}.stenosis_coefficient": present + self._coefficient(place, sizes["loss"], anatomy)}

    def physical(self, place, sizes, anatomy):
        return {"stenosis_coefficient added": self._coefficient(place, sizes["loss"], anatomy)}

    @staticmethod
    def _coefficient(place, loss, anatomy):
        return loss * anatomy.pressure / anatomy.flow_scale(place) ** 2
