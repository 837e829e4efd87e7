"""Settings of the 0D stage: solver, time steps, periodicity, jobs."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from coronaryuq.core.remote_model import RemoteSettings


class Settings(BaseModel):
    """0D runs of the pilot, propagation and resampled samples."""

    model_config = ConfigDict(extra="forbid")

    backend: Literal["coronaryuq", "svzerod", "umbridge"] = Field(
        "coronaryuq", description="Solver; svzerod needs svZeroDSolver (pip install svzerod), umbridge needs a server."
    )
    umbridge: RemoteSettings = Field(
        default_factory=RemoteSettings, description="Server of the 0D model, if the `backend` is umbridge."
    )
    steps_per_cycle: int | None = Field(
        None, ge=10, description="Time steps per cardiac cycle; null: as in the network file."
    )
    periodic: bool = Field(
        True, description="Run to the periodic state; if false, exactly `cycles` cycles from the initial condition."
    )
    cycles: int = Field(60, ge=1, description="Number of cardiac cycles; the maximum if `periodic`.")
    tolerance: float = Field(1e-4, gt=0, lt=1, description="Relative cycle-to-cycle error that counts as periodic.")
    batch: int = Field(64, ge=1, description="Samples advanced together.")
    threads: int = Field(1, ge=1, description="Threads, each with its own groups of samples.")
    chunk: int = Field(500, ge=1, description="Samples per job.")
