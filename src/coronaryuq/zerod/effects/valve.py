"""Aortic valve that opens too little or does not close."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect, Parameter, Series, Values


class AorticStenosis(Effect):
    """Higher resistance from the left ventricle to the aorta."""

    name = "aortic_stenosis"
    formula = "R_lv,ao = R_model (1 + s): the mean effect of dP = rho Q^2 / (2 EOA^2) at the mean systolic flow"
    source = "Gorlin & Gorlin, Am. Heart J. 41 (1951) 1 (orifice); Kim et al., Ann. Biomed. Eng. 37 (2009) 2153 (heart)"
    signature = "ventricular pressure above aortic pressure in systole; later and lower aortic peak"
    native = "Rlv_ao of ClosedLoopHeartAndPulmonary"
    parameters = (
        Parameter("rise", "1", "lognormal", 2.0, 1.0, "added resistance over the present resistance of the open valve"),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        hearts = anatomy.network.get("closed_loop_blocks", [])
        return ["aortic valve"] if any("Rlv_ao" in heart.get("parameters", {}) for heart in hearts) else []

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        return {"CLH.Rlv_ao": network.heart["parameters"]["Rlv_ao"] * (1.0 + sizes["rise"])}


class AorticRegurgitation(Effect):
    """Flow from the aorta back into the left ventricle while the valve should be closed."""

    name = "aortic_regurgitation"
    formula = "Q_leak = G (P_ao - P_lv), a residual orifice linearised at the mean diastolic gradient"
    source = "Mynard et al., Int. J. Numer. Meth. Biomed. Eng. 28 (2012) 626: regurgitant valves"
    signature = "lower diastolic and higher pulse pressure in the aorta, larger ventricle, less flow in diastole"
    native = "Gao_leak of ClosedLoopHeartAndPulmonary, our extension of the format that svZeroDSolver does not support"
    parameters = (
        Parameter("share", "1", "lognormal", 0.2, 0.8, "leak at the mean aortic pressure over the cardiac output"),
    )

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return ["aortic valve"] if anatomy.closed_loop else []

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        present = network.heart["parameters"].get("Gao_leak", 0.0)
        return {"CLH.Gao_leak": present + self._conductance(sizes["share"], anatomy)}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {"Gao_leak added": float(self._conductance(sizes["share"], anatomy))}

    @staticmethod
    def _conductance(share: np.ndarray | float, anatomy: Anatomy) -> np.ndarray:
        output = sum(anatomy.flow_scale(vessel) for vessel in anatomy.roots)
        return np.asarray(share) * output / anatomy.pressure
