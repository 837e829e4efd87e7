"""Pressure loss of a stenosis: expansion (separation) loss only, with the viscous loss of its throat, at a place."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from coronaryuq.case.network.network import GRAFTED, Network
from coronaryuq.core import units
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Number, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import grafted, grafted_name
from coronaryuq.zerod.effects.quadratic import QuadraticLoss

FOCAL = "focal"
"""Suffix of the vessel that has the loss of a focal stenosis."""


class QuadraticStenosis(QuadraticLoss):
    """Expansion (separation) loss distal to a stenosis, in addition to the vessel's viscous loss."""

    name = "quadratic_stenosis"
    formula = "dP = (R + S |Q|) Q, S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395; Pfaller et al., Int. J. Numer. Meth. Biomed. Eng. 38 (2022) e3639"
    signature = "distal pressure falls with the square of flow, far more in hyperaemia than at rest"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        passed = pulled_through(observed)
        return [vessel for vessel in anatomy.coronary_vessels if vessel not in passed]


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
    parameters: ClassVar[tuple[Parameter, ...]] = (
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


class FocalStenosis(StenosisWithViscousLoss):
    """Stenosis at a place within a vessel, for vessels through which a pressure wire was pulled.

    The losses are those of a stenosis with viscous loss. They fall evenly between the start and the end of the
    stenosis, which the pullback shows; pressure that returns behind the throat is not modelled.
    """

    name = "focal_stenosis"
    formula = (
        "dP = (R_t + S |Q|) Q between x and x + l, R_t = K_v mu / (2 pi r0^3), S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    )
    source = "Young & Tsai, J. Biomech. 6 (1973) 395; Pijls et al., Circulation 102 (2000) 2371 (serial stenoses)"
    signature = "a step of the pressure along a vessel, at one place in every condition, with flow and its square"
    native = "stenosis_coefficient and R_poiseuille of a vessel added upstream, whose place is its `placed_in`"
    tag = FOCAL
    parameters = (
        *StenosisWithViscousLoss.parameters,
        # A logit-normal fraction with this spread is nearly uniform; as a ratio it is positive like all other sizes.
        Parameter("position", "1", "lognormal", 1.0, 1.5, "length of the vessel ahead of it over that behind it"),
        Parameter("length", "cm", "lognormal", 0.8, 0.5, "length in cm over which the pressure falls"),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        passed, network = pulled_through(observed), anatomy.network
        have = {vessel for vessel in passed if grafted(network, f"{vessel}_{FOCAL}")}
        have |= {v["vessel_name"] for v in network.vessels if v.get(GRAFTED, "").endswith(f"_{FOCAL}")}
        return [vessel for vessel in anatomy.coronary_vessels if vessel in passed and vessel not in have]

    def extent(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> tuple[str, float, float]:
        whole = anatomy.length(place)
        length = min(sizes["length"], whole)
        start = (whole - length) * sizes["position"] / (1.0 + sizes["position"])
        added = grafted_name(anatomy.network, f"{place}_{FOCAL}")
        return added, float(start), float(start + length)

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        _, start, end = self.extent(place, sizes, anatomy)
        return super().physical(place, sizes, anatomy) | {
            "start in the vessel, mm": start / units.MM,
            "end in the vessel, mm": end / units.MM,
        }

    def _added(self, network: Network, vessel: str) -> bool:
        return True


def pulled_through(observed: Sequence[Series]) -> set[str]:
    """Return the vessels through which a pressure wire was pulled."""
    return {vessel for series in observed if series.pullback is not None for vessel in series.pullback.path}
