"""Quadratic pressure loss of a stenosis."""

from coronaryuq.zerod.effects.quadratic import QuadraticLoss


class QuadraticStenosis(QuadraticLoss):
    """Turbulent loss behind a narrowing, beyond the viscous one."""

    name = "quadratic_stenosis"
    formula = "dP = (R + S |Q|) Q, S = K_t rho / (2 A0^2) (A0/As - 1)^2"
    source = "Young & Tsai, J. Biomech. 6 (1973) 395; Pfaller et al., Int. J. Numer. Meth. Biomed. Eng. 38 (2022) e3639"
    signature = "distal pressure falls with the square of flow: far more in hyperaemia than at rest"

    def places(self, anatomy, observed=()):
        return anatomy.coronary_vessels
