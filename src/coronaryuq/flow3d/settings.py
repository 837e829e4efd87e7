"""Settings of the 3D runs."""

from pydantic import BaseModel, ConfigDict, Field, field_validator

from coronaryuq.core.remote_model import RemoteSettings
from coronaryuq.flow3d.simvascular_settings import SimVascularSettings


class Coarse(BaseModel):
    """A cheaper 3D level: the same solver and inputs on a coarser mesh with longer time steps."""

    model_config = ConfigDict(extra="forbid")

    runs_per_fine: int = Field(
        0,
        ge=0,
        le=100,
        description="Coarse 3D runs per 3D run of the pilot: at the pilot's inputs and at further posterior draws; "
        "0: no coarse level.",
    )
    resolution: float = Field(
        0.75,
        gt=0.0,
        lt=1.0,
        description="Resolution of the coarse mesh divided by that of `mesh`; clipped at the smallest value allowed "
        "there.",
    )
    steps: float = Field(0.5, gt=0.0, le=1.0, description="Time steps per cycle divided by those of the fine runs.")
    max_cycles: int = Field(
        2, ge=2, le=200, description="Maximum number of whole cycles; never more than for the fine runs."
    )

    @field_validator("runs_per_fine")
    @classmethod
    def _more_than_the_pilot(cls, value: int) -> int:
        if value == 1:
            raise ValueError("the coarse level needs more runs than the pilot: 2 or more, or 0 for no coarse level")
        return value


class Settings(BaseModel):
    """Settings of the 3D runs. Step counts are per cardiac cycle, so that one set fits any heart rate."""

    model_config = ConfigDict(extra="forbid")

    steps_per_cycle: int = Field(
        800, ge=100, le=100000, description="Time steps per cardiac cycle of the 3D model and the coupled 0D network."
    )
    ramp_cycles: float = Field(
        0.25,
        ge=0.0,
        le=2.0,
        description="Fraction of a cycle run before the first whole cycle, from fluid at rest and the periodic 0D "
        "state.",
    )
    min_cycles: int = Field(
        2, ge=2, le=50, description="Minimum number of whole cycles; two are needed to judge convergence."
    )
    max_cycles: int = Field(
        6,
        ge=2,
        le=200,
        description="Maximum number of whole cycles; a sample that still changes by more than `tolerance` is marked "
        "as not converged.",
    )
    tolerance: float = Field(
        2e-3,
        gt=0.0,
        le=0.1,
        description="Largest change of any quantity of interest between cycles at which a sample counts as converged: "
        "absolute for FFR and OSI, relative to the region's mean for wall shear stress.",
    )
    wall_samples_per_cycle: int = Field(
        200,
        ge=20,
        le=10000,
        description="Number of times per cycle at which wall shear stress and the pressure on the FFR planes "
        "are sampled.",
    )
    momentum_tolerance: float = Field(
        3e-3, gt=0.0, lt=1.0, description="Relative change at which the Gauss-Seidel sweeps of a momentum step stop."
    )
    momentum_sweeps: int = Field(
        60, ge=5, le=1000, description="Maximum number of Gauss-Seidel sweeps of a momentum step."
    )
    backflow_stabilisation: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="Fraction of the incoming momentum flux that is damped where blood flows in through an outlet.",
    )
    refinements: int = Field(
        2,
        ge=0,
        le=4,
        description="Number of times that a diverged sample is run again, each time with twice as many steps.",
    )
    speed_limit: float = Field(3000.0, gt=0.0, description="Speed above which a sample counts as diverged, cm/s.")
    checkpoints: bool = Field(
        True, description="Save the state at the end of every cycle, to resume after an interruption."
    )
    fields: int = Field(
        1,
        ge=0,
        description="Number of samples, counted from the first, whose fields are kept for figures (VTU, VTP).",
    )
    low_shear: float = Field(
        10.0,
        gt=0.0,
        description="Time-averaged wall shear stress (dyn/cm2) below which it counts as low, for the area fraction "
        "`low_shear_area_X`. The default, 1 Pa, is that of Stone et al. 2012 (Circulation 126:172).",
    )
    mesh_study: float = Field(
        0.25,
        ge=0.0,
        le=10.0,
        description="Largest cost of the mesh study, as a fraction of the cost of the 3D runs. The study runs a few "
        "samples again on a coarser and a finer mesh and with longer time steps, as far as the fraction allows. "
        "0: mesh and time-step errors are not measured, unless the target `mesh_study` asks for them.",
    )
    coarse: Coarse = Field(default_factory=Coarse, description="A coarse 3D level for the estimates, off by default.")
    umbridge: RemoteSettings = Field(
        default_factory=RemoteSettings, description="Server of the 3D model, if the `backend` is umbridge."
    )
    simvascular: SimVascularSettings = Field(
        default_factory=SimVascularSettings, description="svSolver and svMultiPhysics, if one of them is the `backend`."
    )
