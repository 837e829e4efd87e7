"""Valves of the heart that open too little or do not close."""

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
        return np.asarray(share) * cardiac_output(anatomy) / anatomy.pressure


class MitralStenosis(Effect):
    """Higher resistance from the left atrium to the left ventricle."""

    name = "mitral_stenosis"
    formula = "R_la,v = R_model + s P_ao / CO: the mean effect of dP = rho Q^2 / (2 EOA^2) at the mean diastolic flow"
    source = "Gorlin & Gorlin, Am. Heart J. 41 (1951) 1 (orifice); Kim et al., Ann. Biomed. Eng. 37 (2009) 2153 (heart)"
    signature = "left atrial pressure above ventricular pressure in diastole; less filling, lower output and pressure"
    native = "Rla_v of ClosedLoopHeartAndPulmonary"
    # At 90 mmHg the median is 4.5 mmHg at the mean output: twice that while the valve is open, a moderate stenosis.
    parameters = (
        Parameter("loss", "1", "lognormal", 0.05, 0.8, "pressure lost at the cardiac output over the aortic pressure"),
    )
    element, valve = "Rla_v", "mitral valve"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        hearts = anatomy.network.get("closed_loop_blocks", [])
        return [self.valve] if any(self.element in heart.get("parameters", {}) for heart in hearts) else []

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        present = network.heart["parameters"][self.element]
        return {f"CLH.{self.element}": present + self._resistance(sizes["loss"], anatomy)}

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        return {f"{self.element} added": float(self._resistance(sizes["loss"], anatomy))}

    @staticmethod
    def _resistance(loss: np.ndarray | float, anatomy: Anatomy) -> np.ndarray:
        return np.asarray(loss) * anatomy.pressure / cardiac_output(anatomy)


class PulmonaryStenosis(MitralStenosis):
    """Higher resistance from the right ventricle to the pulmonary artery."""

    name = "pulmonary_stenosis"
    formula = "R_rv,a = R_model + s P_ao / CO: the mean effect of dP = rho Q^2 / (2 EOA^2) at the mean systolic flow"
    signature = "right ventricular pressure above pulmonary pressure in systole; larger right heart, lower output"
    native = "Rrv_a of ClosedLoopHeartAndPulmonary"
    # At 90 mmHg the median is 9 mmHg at the mean output: three times that in systole, a mild to moderate stenosis.
    parameters = (
        Parameter("loss", "1", "lognormal", 0.1, 0.8, "pressure lost at the cardiac output over the aortic pressure"),
    )
    element, valve = "Rrv_a", "pulmonary valve"


def cardiac_output(anatomy: Anatomy) -> float:
    """Return the mean flow out of the heart of the unmodified model."""
    return sum(anatomy.flow_scale(vessel) for vessel in anatomy.roots)
