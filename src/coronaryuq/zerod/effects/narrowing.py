"""Diffuse narrowing of a vessel."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Number, Parameter, Series, Values


class DiffuseNarrowing(Effect):
    """Radius smaller than assumed along the whole vessel: more viscous loss and inertance, less storage."""

    name = "diffuse_narrowing"
    formula = (
        "R = 8 mu l / (pi r^4), L = rho l / (pi r^2), C ~ r^3: with added R, L grows as R^(1/2), C falls as R^(-3/4)"
    )
    source = "De Bruyne et al., Circulation 104 (2001) 2401; Poiseuille's law"
    signature = "distal pressure falls in proportion to flow, at rest as in hyperaemia"
    native = "R_poiseuille, L and C of the vessel"
    parameters = (
        Parameter(
            "loss",
            "1",
            "lognormal",
            0.1,
            1.2,
            "fraction of the mean pressure lost to the added resistance at mean flow",
        ),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return anatomy.coronary_vessels

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        element = network.vessel_values(place)
        present = element.get("R_poiseuille", 0.0)
        added = self._resistance(place, sizes["loss"], anatomy)
        changes: Values = {f"{place}.R_poiseuille": present + added}
        if present > 0.0:
            ratio = 1.0 + added / present
            for name, power in (("L", 0.5), ("C", -0.75)):
                if element.get(name, 0.0) > 0.0:
                    changes[f"{place}.{name}"] = element[name] * ratio**power
        return changes

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        added = self._resistance(place, sizes["loss"], anatomy)
        present = anatomy.vessels[place]["zero_d_element_values"].get("R_poiseuille", 0.0)
        radius = {"radius over the model's": float(np.power(present / (present + added), 0.25))} if present > 0 else {}
        return {"R_poiseuille added": added, **radius}

    @staticmethod
    def _resistance(place: str, loss: Number, anatomy: Anatomy) -> Number:
        return loss * anatomy.pressure / anatomy.flow_scale(place)
