"""What the 0D stage may be told: time steps, how periodic, and by which solver."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from coronaryuq.core.remote_model import RemoteSettings


class Settings(BaseModel):
    """0D runs of the pilot, propagation and resampled samples."""

    model_config = ConfigDict(extra="forbid")

    backend: Literal["coronaryuq", "svzerod", "umbridge"] = Field(
        "coronaryuq", description="solver; svzerod needs svZeroDSolver (pip install svzerod), umbridge a server"
    )
    umbridge: RemoteSettings = Field(
        default_factory=RemoteSettings, description="Server of the 0D model, if the `backend` is umbridge."
    )
    steps_per_cycle: int | None = Field(
        None, ge=10, description="time steps per cardiac cycle (1); the network's own when null"
    )
    periodic: bool = Field(
        True, description="run until periodic; otherwise exactly `cycles` from the initial condition"
    )
    cycles: int = Field(60, ge=1, description="cardiac cycles: the most when periodic, else exactly these (1)")
    tolerance: float = Field(1e-4, gt=0, lt=1, description="relative cycle-to-cycle error that counts as periodic (1)")
    batch: int = Field(64, ge=1, description="samples advanced together (1)")
    threads: int = Field(1, ge=1, description="threads over groups of samples (1)")
    chunk: int = Field(500, ge=1, description="samples per job (1)")
