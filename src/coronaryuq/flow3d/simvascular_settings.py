"""Settings of the SimVascular 3D codes: programs, launch, time steps, output."""

from pydantic import BaseModel, ConfigDict, Field


class SimVascularSettings(BaseModel):
    """How svSolver and svMultiPhysics are run. Programs are names on the PATH or paths."""

    model_config = ConfigDict(extra="forbid")

    mpi: str = Field("mpiexec", min_length=1, description="MPI launcher, called as `{mpi} -n {tasks} program`.")
    svpre: str = Field("svpre", description="svSolver's preprocessor.")
    svsolver: str = Field(
        "svsolver",
        description="svSolver with svZeroD coupling: branch interface_svzerod of menon-karthik/svSolver.",
    )
    svpost: str = Field("svpost", description="svSolver's postprocessor.")
    svmultiphysics: str = Field("svmultiphysics", description="svMultiPhysics.")
    zerod_library: str = Field(
        "libsvzero_interface.so",
        description="svZeroDSolver's shared library: an absolute path, or a name in LD_LIBRARY_PATH.",
    )
    steps_per_cycle: int = Field(1000, ge=20, le=100000, description="3D time steps per cardiac cycle.")
    cycles: int = Field(
        5, ge=1, le=100, description="Cardiac cycles; quantities of interest are averages over the last."
    )
    frames_per_cycle: int = Field(
        50, ge=4, le=1000, description="Fields written per cycle, from which TAWSS, OSI and FFR are computed."
    )
    zerod_points: int = Field(50, ge=10, le=1000, description="0D time points per 3D step.")
    iterations: int = Field(4, ge=1, le=20, description="Largest number of nonlinear iterations per 3D step.")
    tolerance: float = Field(1e-3, gt=0.0, le=0.1, description="Residual at which the nonlinear iterations stop.")
    backflow_stabilisation: float = Field(0.2, ge=0.0, le=1.0, description="Backflow stabilisation coefficient.")
    stop_after: int | None = Field(
        None,
        ge=1,
        description="Number of time steps after which to stop, for trials; the sample is then recorded as "
        "failed. Null: all cycles.",
    )
    time_limit: float = Field(172800.0, gt=0.0, description="Largest wall time of one sample, s.")
    keep: bool = Field(False, description="Keep the run directory of a sample that succeeded.")
