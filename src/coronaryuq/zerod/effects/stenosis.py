"""Pressure loss of a stenosis: expansion (separation) loss only, and with the viscous loss of its throat."""

from collections.abc import Mapping, Sequence

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Number, Parameter, Series, Values
from coronaryuq.zerod.effects.quadratic import QuadraticLoss


class QuadraticStenosis(QuadraticLoss):
    """Expansion (separation) loss distal to a stenosis, in addition to the vessel's viscous loss."""

    name = "quadratic_stenosis"
    formula = "dP = (R + S |Q|) Q, S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395; Pfaller et al., Int. J. Numer. Meth. Biomed. Eng. 38 (2022) e3639"
    signature = "distal pressure falls with the square of flow, far more in hyperaemia than at rest"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.coronary_vessels


class StenosisWithViscousLoss(QuadraticStenosis):
    """Viscous loss in the throat of a stenosis and expansion (separation) loss distal to it.

    In long or mild stenoses the two are of equal size; with the expansion loss alone they would be identified as a
    diffuse narrowing. There is no effect with a free exponent, dP = K |Q|^(n-1) Q with n from 1 to 2: the solvers have
    no such element, and R Q + S |Q| Q differs from it by at most 1.2 % of the largest loss if flow varies sixteenfold.
    """

    name = "stenosis_with_viscous_loss"
    formula = "dP = (R + R_t + S |Q|) Q, R_t = K_v mu / (2 pi r0^3), S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395"
    signature = (
        "distal pressure falls with flow and with its square: already at rest, and more than in proportion above"
    )
    native = f"R_poiseuille and {QuadraticLoss.native}"
    parameters = (
        # The formula gives 0.1, 1.3 and 36 % for area reductions of 45, 75 and 94 % at a mean velocity of 15 cm/s. Less
        # than for the expansion loss alone, as viscous loss is a large part of the loss of a mild stenosis.
        Parameter("loss", "1", "lognormal", 0.02, 1.5, "expansion loss over the mean pressure, at mean flow"),
        Parameter("viscous", "1", "lognormal", 1.0, 1.0, "viscous loss over expansion loss, at mean flow"),
    )

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        changes = super().changes(network, place, sizes, anatomy, condition)
        for name in [key.removesuffix(".stenosis_coefficient") for key in changes]:
            present = network.vessel_values(name).get("R_poiseuille", 0.0)
            changes[f"{name}.R_poiseuille"] = present + self._viscous(place, sizes, anatomy)
        return changes

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return super().physical(place, sizes, anatomy) | {"R_poiseuille added": self._viscous(place, sizes, anatomy)}

    @staticmethod
    def _viscous(place: str, sizes: Mapping[str, Number], anatomy: Anatomy) -> Number:
        return sizes["viscous"] * sizes["loss"] * anatomy.pressure / anatomy.flow_scale(place)
