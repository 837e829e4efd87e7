"""Settings of the mesh: domain, resolution, regions, limits."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Part of the anatomy to mesh, and its resolution; in vessel diameters or ratios, so that one set fits all."""

    model_config = ConfigDict(extra="forbid")

    domain: Literal["segments", "trees", "whole", "lumen"] = Field(
        "segments",
        description="Part of the anatomy in 3D; the rest stays 0D. From centrelines and radii: `segments` (each "
        "stenosis "
        "with its neighbourhood), `trees` (each coronary tree from its ostium), `whole` (with the aorta). `lumen`: the "
        "case's own closed surface or mesh-complete folder.",
    )
    throat_resolution: float = Field(
        4.0, ge=2.0, le=20.0, description="Radius over element size (R/h) at the throat of a stenosis."
    )
    resolution: float = Field(2.0, ge=1.5, le=20.0, description="Local radius over element size (R/h) elsewhere.")
    jet_resolution: float = Field(
        2.0,
        ge=1.5,
        le=20.0,
        description="Smallest R/h from a throat to the end of the stenosis region, where the jet determines wall "
        "shear; "
        "at most `throat_resolution`.",
    )
    core_resolution: float = Field(
        3.0,
        ge=0.0,
        le=20.0,
        description="Throat radius over element size in the jet's core (1.5 throat radii around the axis, from the "
        "throat "
        "to the end of the stenosis region); 0: no refinement of the core.",
    )
    wall_grading: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="Grading of nodes towards the wall at a throat, where the boundary layer is thin: relative depth "
        "is raised to the power of 1 plus this value; 0: no grading.",
    )
    axial_stretch: float = Field(
        2.0,
        ge=1.0,
        le=3.0,
        description="Ratio of length to width of elements from a throat to the end of the stenosis region, "
        "where flow changes slowly along the vessel; the resolutions above refer to widths.",
    )
    gradation: float = Field(1.3, gt=1.0, le=2.0, description="Largest ratio of neighbouring edge lengths.")
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
        description="`segments`: length of a side branch kept beyond its parent's wall, in diameters of the branch.",
    )
    region_upstream_diameters: float = Field(
        0.5,
        ge=0.0,
        le=10.0,
        description="Extent of the stenosis region for wall shear upstream of the stenosis, in local diameters.",
    )
    region_downstream_diameters: float = Field(
        2.0,
        ge=0.0,
        le=10.0,
        description="Extent of the stenosis region downstream of the stenosis, in local diameters.",
    )
    ffr_diameters: float = Field(
        2.5,
        ge=0.0,
        le=50.0,
        description="Distance from the stenosis to the plane of the distal pressure of FFR, in local diameters, "
        "for cases with `ffr_beyond_mm: null`.",
    )
    time_limit: float = Field(600.0, gt=0.0, description="Maximum CPU time of one meshing attempt of one piece, s.")
    attempts: int = Field(4, ge=1, le=10, description="Meshing attempts per piece before the case is rejected.")
