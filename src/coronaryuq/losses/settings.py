"""Settings of the pressure losses that 3D runs teach the 0D model."""

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """How the pressure losses of the 0D vessels are learnt from 3D runs."""

    model_config = ConfigDict(extra="forbid")

    runs_3d: int = Field(
        8,
        ge=0,
        le=200,
        description="Number of 3D runs, before all others, from which the 0D model learns the pressure losses of the "
        "vessels that are also simulated in 3D; calibration, posterior and 0D runs then use them. The ensemble solver "
        "advances 8 together. 0: the 0D vessels keep their own losses, as in the paper.",
    )
