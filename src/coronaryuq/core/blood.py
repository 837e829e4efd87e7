"""Viscosity of blood from its haematocrit."""

from coronaryuq.core.units import BLOOD_VISCOSITY

PLASMA_VISCOSITY = 0.012
"""Poise, at 37 °C (Késmárky et al. 2008: 0.011 to 0.013)."""


def viscosity_of(haematocrit: float | None) -> float:
    """Return the viscosity (poise) of blood of a haematocrit in vessels much wider than its cells.

    The law of Pries, Neuhaus & Gaehtgens, Am. J. Physiol. 263 (1992) H1770, for large diameters. Without a haematocrit
    it is the paper's 0.04 P, that of 0.47.
    """
    return BLOOD_VISCOSITY if haematocrit is None else PLASMA_VISCOSITY * _relative(haematocrit)


def _relative(haematocrit: float) -> float:
    return 1.0 + 2.2 * ((1.0 - haematocrit) ** -0.8 - 1.0) / (0.55**-0.8 - 1.0)
