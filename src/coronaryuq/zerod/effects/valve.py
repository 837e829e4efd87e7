"""Aortic valve that opens too little."""

from coronaryuq.zerod.effects.base import Effect, Parameter


class AorticStenosis(Effect):
    """More resistance from the left ventricle to the aorta.

    Regurgitation needs flow back through the closed valve, which the closed-loop heart of svZeroDSolver cannot express
    (its valve has no leak), so it is not in the library.
    """

    name = "aortic_stenosis"
    formula = "R_lv,ao = R_model (1 + s): the mean effect of dP = rho Q^2 / (2 EOA^2) at the mean systolic flow"
    source = "Garcia et al., Circulation 101 (2000) 765; Kim et al., Ann. Biomed. Eng. 37 (2009) 2153 (heart model)"
    signature = "ventricular pressure above the aortic in systole, later and lower aortic peak"
    native = "Rlv_ao of ClosedLoopHeartAndPulmonary"
    parameters = (Parameter("rise", "1", "lognormal", 2.0, 1.0, "added over present resistance of the open valve"),)

    def places(self, anatomy, observed=()):
        hearts = anatomy.network.get("closed_loop_blocks", [])
        return ["aortic valve"] if any("Rlv_ao" in heart.get("parameters", {}) for heart in hearts) else []

    def changes(self, network, place, sizes, anatomy, condition):
        return {"CLH.Rlv_ao": network["closed_loop_blocks"][0]["parameters"]["Rlv_ao"] * (1.0 + sizes["rise"])}
