"""Settings of the estimation stage."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator


class Settings(BaseModel):
    """Estimators, their training, and their intervals."""

    model_config = ConfigDict(extra="forbid")

    level: float = Field(0.95, gt=0.5, lt=1, description="Confidence level of the calibrated intervals.")
    folds: int = Field(
        5, ge=2, le=50, description="Number of folds of cross-fitting; doubled for pilot samples below 100 runs."
    )
    ffr_zones: tuple[float, ...] = Field(
        (0.75, 0.80),
        min_length=1,
        description="Rising limits of FFR between the zones whose probabilities are estimated; at or below the last "
        "one a stenosis counts as significant.",
    )
    input_groups: dict[str, list[str]] = Field(
        {},
        description="Names of groups and the inputs of each that count as one in Shapley effects and total indices, "
        "such as the beds of one artery; inputs in no group stand for themselves.",
    )
    cost_ratio: float = Field(
        1e-5,
        gt=0,
        lt=1,
        description="Cost of a 0D run relative to a 3D run; plans of a growing campaign use this value, so "
        "that they are reproducible, and the budget figures use the measured ratio if it is known.",
    )
    known_scaling: Literal["R_cor_scaling"] | None = Field(
        "R_cor_scaling",
        description="Input with a known uniform distribution, independent of the others, that may be "
        "integrated exactly.",
    )
    autoencoder: bool = Field(
        True,
        description="Train MFMC-AE and run the 0D model at its resampled inputs, for the rows of the paper's table "
        "(`networks` in rows.csv).",
    )
    steps: tuple[int, int] = Field((1200, 1500), description="Adam steps in the first and second stage of training.")
    batch: int = Field(128, ge=0, description="Runs per training step; 0: all runs.")
    curve_nodes: int = Field(65, ge=9, description="0D runs along the curve of resampled inputs, per row and fold.")
    learning_rate: float = Field(5e-3, gt=0, description="Initial learning rate of Adam.")
    decay: float = Field(0.999, gt=0, le=1, description="Factor by which the learning rate is multiplied at each step.")
    restarts: int = Field(
        3, ge=1, le=20, description="Trainings per row and fold; the one with the lowest loss is kept."
    )
    correlation: Literal["kernel", "literal"] = Field(
        "kernel",
        description="Correlation term of the second stage: through a kernel distribution function, or the paper's "
        "empirical count.",
    )
    optuna_trials: int = Field(
        20, ge=1, description="Number of Optuna trials of the target `tuning`; the first uses these settings."
    )
    rows: list[str] = Field([], description="Names of the rows to estimate; empty: all rows of rows.csv.")
    convergence_subsamples: int = Field(
        200, ge=2, description="Number of subsamples of each size in the convergence study."
    )
    convergence_subsamples_fitted: int = Field(
        20, ge=0, description="Number of those subsamples that train networks and control variates (paper: all 200)."
    )
    target_half_width: dict[str, float] = Field(
        {}, description="Target half-width of the calibrated interval, by row name."
    )
    max_3d: int | None = Field(
        None,
        ge=8,
        description="Maximum number of 3D runs of a campaign that grows to reach `target_half_width`; null: no growth.",
    )
    max_0d: int | None = Field(None, ge=16, description="Maximum number of propagation runs; null: no growth.")
    max_chain: int = Field(
        16,
        ge=1,
        description="Maximum length of the posterior's chains of a campaign that grows, over that of the first round, "
        "burn-in apart. Where the chains limit the error they are doubled, with the propagation runs, as far as "
        "`max_0d` allows.",
    )
    rounds: int = Field(
        5,
        ge=1,
        le=20,
        description="Maximum number of rounds of growth, each of which at most doubles the runs and the chains.",
    )
    convergence_rows: list[str] = Field([], description="Rows of the convergence study; empty: FFR with 0D FFR.")
    convergence_sizes: list[int] = Field(
        [25, 50, 100, 150, 200, 250, 300, 400], description="Subsample sizes (3D runs) of the convergence study."
    )
    coverage_sizes: list[int] = Field([25, 50, 100, 250], description="Pilot sample sizes of the target `coverage`.")
    coverage_replicates: int = Field(400, ge=2, description="Repeated trials per cell of the target `coverage`.")
    min_3d: int = Field(20, ge=4, description="Smallest number of usable 3D runs for any estimate.")

    @field_validator("ffr_zones")
    @classmethod
    def _rising(cls, limits: tuple[float, ...]) -> tuple[float, ...]:
        ends = (0.0, *limits, 1.0)
        if any(after <= before for before, after in zip(ends, ends[1:], strict=False)):
            raise ValueError("give rising limits between 0 and 1")
        return limits
