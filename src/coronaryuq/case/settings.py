"""Settings of the case stage: how a patient's files become a tree, a 0D network and a ventricle."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

Uncertainty = Literal["full", "paper"]
"""What a campaign takes as uncertain: all that is measured, or perfusion and resistances alone, as in the paper."""
STENOSIS_LOSS = 1.52
"""K_t of Young and Tsai (1973), used by Pfaller et al. (2022), Eq. 7."""
KINETIC_FACTOR = 2.0
"""Kinetic energy of a developed velocity profile over that of a flat one with the same flow."""
MURRAY_EXPONENT = 2.6
"""Exponent of outlet flow as a power of outlet radius (paper, section 2.3; Zhou et al. 1999)."""
YOUNG, THICKNESS_RATIO = 1.15e7, 0.1
"""Young's modulus of elastic walls (Gow & Hadfield 1979), dyn/cm2, and their thickness over the radius."""
CORONARY_SHARE = 0.04
"""Coronary fraction of cardiac output where it is not a target."""


class Settings(BaseModel):
    """Settings for reading and completing a case; the patient's own data belong in `case.yaml`."""

    model_config = ConfigDict(extra="forbid")

    stenosis_loss: float = Field(
        STENOSIS_LOSS,
        ge=0,
        le=5,
        description="K_t of the stenosis law ΔP = K_t ρ/(2 A_0²) (A_0/A_s − 1)² Q² in a network that is built from an "
        "anatomy: 1.52 as published; 1.0 agrees better with 3D flow in smooth, cosine-shaped narrowings.",
    )
    kinetic_factor: float = Field(
        KINETIC_FACTOR,
        ge=0,
        le=3,
        description="α of the pressure α ρ v̄²/2 that speeds the blood up where an artery leaves the aorta: 2 for a "
        "developed velocity profile, 1 for a flat one, 0 to leave it out.",
    )
    walls: Literal["rigid", "elastic"] = Field(
        "rigid",
        description="Vessel walls: rigid (no capacitance, as in the paper) or elastic (C from E h/r).",
    )
    young: float = Field(YOUNG, gt=0, description="Young's modulus of elastic walls (Gow & Hadfield 1979), dyn/cm2.")
    thickness_ratio: float = Field(
        THICKNESS_RATIO, gt=0, lt=1, description="Thickness of elastic walls divided by the radius."
    )
    murray_exponent: float = Field(
        MURRAY_EXPONENT,
        gt=1,
        lt=4,
        description="Power of the outlet radius to which initial flows are proportional (Zhou et al. 1999).",
    )
    coronary_share: float = Field(
        CORONARY_SHARE,
        gt=0,
        lt=0.5,
        description="Coronary fraction of cardiac output for initial resistances, if it is not a target.",
    )
    wall_cells: int = Field(
        60_000,
        ge=1000,
        le=5_000_000,
        description="Maximum number of LV cells of an image or voxel map; voxels are merged if there are more.",
    )
    surface_spacing: float | None = Field(
        None,
        gt=0,
        le=0.5,
        description="Point spacing on a closed surface for centreline extraction, cm; null: from the smallest outlet.",
    )
    narrowing: float = Field(
        0.7, gt=0, lt=1, description="Area ratio below which `stenoses: auto` counts a narrowing as a stenosis."
    )
    serial: float = Field(
        0.5,
        gt=0,
        lt=1,
        description="Area ratio below which it also counts those that are not the narrowest of their artery, and the "
        "left main's: 0.5 is 30 % of the diameter.",
    )
