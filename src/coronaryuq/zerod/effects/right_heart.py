"""Right ventricle that contracts too weakly."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values


class RightHeartWeakness(Effect):
    """Lower elastance of the right ventricle; the element scales systolic and diastolic elastance together."""

    name = "right_heart_weakness"
    formula = "E_rv(t) = E_model(t) / (1 + w)"
    source = (
        "Suga & Sagawa, Circ. Res. 35 (1974) 117 (elastance); "
        "Vonk-Noordegraaf et al., J. Am. Coll. Cardiol. 69 (2017) 236 (right ventricle)"
    )
    signature = "larger right ventricle with a lower peak pressure and a smaller right atrium; if severe, lower output"
    native = "Erv_s of ClosedLoopHeartAndPulmonary"
    parameters = (
        Parameter("weakness", "1", "lognormal", 0.5, 0.7, "elastance in the model over the actual one, minus 1"),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        hearts = anatomy.network.get("closed_loop_blocks", [])
        return ["right ventricle"] if any("Erv_s" in heart.get("parameters", {}) for heart in hearts) else []

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        return {"CLH.Erv_s": network.heart["parameters"]["Erv_s"] / (1.0 + np.asarray(sizes["weakness"]))}
