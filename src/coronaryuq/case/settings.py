"""Settings of the case stage: how a patient's files become a tree, a 0D network and a ventricle."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """How the case is read and completed. What belongs to the patient stands in `case.yaml`, not here."""

    model_config = ConfigDict(extra="forbid")

    stenosis_loss: float = Field(
        1.52,
        ge=0,
        le=5,
        description="K_t of the stenosis law ΔP = K_t ρ/(2 A_0²) (A_0/A_s − 1)² Q². 1.52 is the published rule; "
        "for smooth, cosine-shaped narrowings 1.0 fits 3D better",
    )
    walls: Literal["rigid", "elastic"] = Field(
        "rigid", description="rigid: no vessel capacitance, as in the paper's 3D model; elastic: C from E h/r"
    )
    young: float = Field(1.15e7, gt=0, description="Young's modulus of elastic walls, dyn/cm2 (Gow & Hadfield 1979)")
    thickness_ratio: float = Field(0.1, gt=0, lt=1, description="wall thickness over radius of elastic walls")
    murray_exponent: float = Field(
        2.6, gt=1, lt=4, description="initial outlet flows go as radius to this power (Murray; Zhou et al. 1999)"
    )
    coronary_share: float = Field(
        0.04, gt=0, lt=0.5, description="coronary share of cardiac output for initial resistances, if no target says it"
    )
    wall_cells: int = Field(
        60_000, ge=1000, le=5_000_000, description="most LV cells kept of an image or voxel map; more are merged evenly"
    )
    surface_spacing: float | None = Field(
        None,
        gt=0,
        le=0.5,
        description="grid spacing in cm for centrelines of a closed surface; none: from its narrowest outlet",
    )
    narrowing: float = Field(
        0.7, gt=0, lt=1, description="area ratio below which `stenoses: auto` calls a narrowing a stenosis"
    )
