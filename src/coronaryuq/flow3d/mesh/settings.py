"""Settings of the mesh: domain, resolution, regions, limits."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """What part of the anatomy is meshed, and how finely. Lengths in vessel diameters or as ratios, so that one set
    fits any patient.
    """

    model_config = ConfigDict(extra="forbid")

    domain: Literal["segments", "trees", "whole", "lumen"] = Field(
        "segments",
        description="Part of the anatomy in 3D, the rest stays 0D: `segments` (each stenosis with its neighbourhood), "
        "`trees` (each coronary tree from its ostium), `whole` (with the aorta), all three made from centrelines and "
        "radii; `lumen`: the case's own closed surface or mesh-complete folder, whatever it holds.",
    )
    throat_resolution: float = Field(
        4.0, ge=2.0, le=20.0, description="Radius over element size (R/h) at the throat of a stenosis."
    )
    resolution: float = Field(2.0, ge=1.5, le=20.0, description="Local radius over element size (R/h) elsewhere.")
    jet_resolution: float = Field(
        2.0,
        ge=1.5,
        le=20.0,
        description="Least local radius over element size (R/h) from a throat to the end of the stenosis region, where "
        "the jet sets wall shear; `throat_resolution` if that is less.",
    )
    core_resolution: float = Field(
        3.0,
        ge=0.0,
        le=20.0,
        description="Radius of the throat over element size within one and a half such radii of the axis, from the "
        "throat to the end of the stenosis region, so that the jet is not mixed away; 0: as the rest.",
    )
    wall_grading: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="How far nodes are drawn to the wall at a throat, where the boundary layer is thin: depth over "
        "radius to the power of 1 plus this; 0: not at all.",
    )
    axial_stretch: float = Field(
        2.0,
        ge=1.0,
        le=3.0,
        description="Length along the vessel over width of elements at a throat and behind it to the end of the "
        "stenosis region, where flow changes quickly across the vessel and slowly along it; sizes above are widths.",
    )
    gradation: float = Field(
        1.3, gt=1.0, le=2.0, description="Largest ratio of neighbouring edge lengths that the mesher may leave."
    )
    upstream_diameters: float = Field(
        2.0, ge=1.0, le=50.0, description="`segments`: length kept upstream of the stenosis, in local diameters."
    )
    downstream_diameters: float = Field(
        3.0, ge=1.5, le=50.0, description="`segments`: length kept downstream of the stenosis, in local diameters."
    )
    stub_diameters: float = Field(
        1.5,
        ge=1.0,
        le=20.0,
        description="`segments`: length of a side branch kept beyond its mother's wall, in its diameters.",
    )
    region_upstream_diameters: float = Field(
        0.5,
        ge=0.0,
        le=10.0,
        description="Stenosis region for wall shear: reach upstream of the stenosis, in local diameters.",
    )
    region_downstream_diameters: float = Field(
        2.0, ge=0.0, le=10.0, description="Stenosis region for wall shear: reach downstream of it, in local diameters."
    )
    ffr_diameters: float = Field(
        2.5,
        ge=0.0,
        le=50.0,
        description="Distance of the plane for distal pressure beyond the stenosis, in local diameters.",
    )
    time_limit: float = Field(600.0, gt=0.0, description="CPU time that one meshing attempt of one piece may take, s.")
    attempts: int = Field(4, ge=1, le=10, description="Meshing attempts per piece before the case is refused.")
