"""Settings of the 3D runs."""

from pydantic import BaseModel, ConfigDict, Field, field_validator

from coronaryuq.flow3d.simvascular_settings import SimVascularSettings


class Coarse(BaseModel):
    """A cheaper 3D level: the same solver and inputs on a coarser mesh with longer time steps."""

    model_config = ConfigDict(extra="forbid")

    runs_per_fine: int = Field(
        0,
        ge=0,
        le=100,
        description="Coarse 3D runs per 3D run of the pilot: the pilot's own inputs and further draws of the "
        "posterior; 0: no coarse level.",
    )
    resolution: float = Field(
        0.75,
        gt=0.0,
        lt=1.0,
        description="Every resolution of the coarse mesh in those of `mesh`, as far down as these may go.",
    )
    steps: float = Field(0.5, gt=0.0, le=1.0, description="Time steps per cycle in those of the fine runs.")
    max_cycles: int = Field(2, ge=2, le=200, description="Whole cycles run at most, and never more than the fine runs.")

    @field_validator("runs_per_fine")
    @classmethod
    def _more_than_the_pilot(cls, value: int) -> int:
        if value == 1:
            raise ValueError("the coarse level runs more than the pilot's inputs: 2 or more, or 0 for none")
        return value


class Settings(BaseModel):
    """How the 3D samples are run. Step counts are per cardiac cycle, so that one set fits any heart rate."""

    model_config = ConfigDict(extra="forbid")

    steps_per_cycle: int = Field(
        800, ge=100, le=100000, description="Time steps per cardiac cycle, of 3D and coupled 0D side alike."
    )
    ramp_cycles: float = Field(
        0.25,
        ge=0.0,
        le=2.0,
        description="Part of a cycle run before the first whole one, from fluid at rest and the periodic 0D state.",
    )
    min_cycles: int = Field(2, ge=2, le=50, description="Whole cycles run at least; two are needed to compare.")
    max_cycles: int = Field(
        6,
        ge=2,
        le=200,
        description="Whole cycles run at most; a sample that still changes more than `tolerance` says so.",
    )
    tolerance: float = Field(
        2e-3,
        gt=0.0,
        le=0.1,
        description="Largest change of any quantity of interest from one cycle to the next: FFR and OSI absolute, "
        "wall shear stress relative to the region's mean.",
    )
    wall_samples_per_cycle: int = Field(
        200, ge=20, le=10000, description="How often per cycle wall shear stress and pressure on planes are read."
    )
    momentum_tolerance: float = Field(
        3e-3, gt=0.0, lt=1.0, description="Relative change at which the momentum sweeps of a step stop."
    )
    momentum_sweeps: int = Field(60, ge=5, le=1000, description="Momentum sweeps of a step at most.")
    backflow_stabilisation: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="Share of the incoming momentum flux that is damped where an outlet takes in blood.",
    )
    refinements: int = Field(
        2, ge=0, le=4, description="How many times a sample that blew up is run again, each time with twice the steps."
    )
    speed_limit: float = Field(3000.0, gt=0.0, description="Speed (cm/s) above which a sample counts as blown up.")
    checkpoints: bool = Field(
        True, description="Keep the state at the end of every cycle, to go on after an interruption."
    )
    fields: int = Field(
        1,
        ge=0,
        description="For how many samples of the campaign, the first ones, fields are kept for pictures (VTU, VTP).",
    )
    coarse: Coarse = Field(default_factory=Coarse, description="A coarse 3D level for the estimates, off by default.")
    simvascular: SimVascularSettings = Field(
        default_factory=SimVascularSettings, description="svSolver and svMultiPhysics, where they run the samples."
    )
