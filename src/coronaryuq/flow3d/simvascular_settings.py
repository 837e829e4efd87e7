"""Settings of the SimVascular 3D codes: programs, launch, time steps, output."""

from pydantic import BaseModel, ConfigDict, Field


class SimVascularSettings(BaseModel):
    """How svSolver and svMultiPhysics are run. Programs are names on the PATH or paths."""

    model_config = ConfigDict(extra="forbid")

    mpi: str = Field("mpiexec", min_length=1, description="MPI launcher, called as `{mpi} -n {tasks} program`.")
    svpre: str = Field("svpre", description="svSolver's preprocessor.")
    svsolver: str = Field("svsolver", description="svSolver with svZeroD coupling.")
    svpost: str = Field("svpost", description="svSolver's postprocessor.")
    svmultiphysics: str = Field("svmultiphysics", description="svMultiPhysics.")
    zerod_library: str = Field(
        "libsvzero_interface.so", description="svZeroDSolver's shared library, absolute path or in LD_LIBRARY_PATH."
    )
    steps_per_cycle: int = Field(1000, ge=20, le=100000, description="3D time steps per cardiac cycle.")
    cycles: int = Field(5, ge=1, le=100, description="Cardiac cycles; quantities are taken over the last.")
    frames_per_cycle: int = Field(50, ge=4, le=1000, description="Fields written per cycle, for TAWSS, OSI and FFR.")
    zerod_points: int = Field(50, ge=10, le=1000, description="0D points per 3D step.")
    iterations: int = Field(4, ge=1, le=20, description="Nonlinear iterations of a 3D step at most.")
    tolerance: float = Field(1e-3, gt=0.0, le=0.1, description="Residual at which they stop.")
    backflow_stabilisation: float = Field(0.2, ge=0.0, le=1.0, description="Backflow stabilisation coefficient.")
    stop_after: int | None = Field(
        None,
        ge=1,
        description="Time steps to stop after, for trials; none: all cycles. Such a run is recorded as failed.",
    )
    time_limit: float = Field(172800.0, gt=0.0, description="Wall time that one sample may take, s.")
    keep: bool = Field(False, description="Keep the run directory of a sample that ended well.")
