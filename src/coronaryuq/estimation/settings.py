"""Settings of the estimation stage."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Estimators, their training, and their intervals."""

    model_config = ConfigDict(extra="forbid")

    level: float = Field(0.95, gt=0.5, lt=1, description="level of the calibrated intervals")
    folds: int = Field(5, ge=2, le=50, description="folds of cross-fitting; pilots below 100 runs use twice as many")
    ffr_threshold: float = Field(0.80, gt=0, lt=1, description="FFR at or below which a stenosis counts as significant")
    cost_ratio: float = Field(
        1e-5,
        gt=0,
        lt=1,
        description="cost of a 0D run in 3D runs; plans of a growing campaign use this value, so that they are "
        "reproducible, and the budget figures use the measured ratio if it is known",
    )
    known_scaling: Literal["R_cor_scaling"] | None = Field(
        "R_cor_scaling",
        description="input with a known uniform law, independent of the others, that may be integrated exactly",
    )
    autoencoder: bool = Field(True, description="train MFMC-AE and run the 0D model at its resampled inputs")
    steps: tuple[int, int] = Field((1200, 1500), description="steps of Adam in the first and second stage of training")
    batch: int = Field(128, ge=0, description="runs per training step; 0 for all of them")
    curve_nodes: int = Field(65, ge=9, description="0D runs along the curve of resampled inputs, per row and fold")
    learning_rate: float = Field(5e-3, gt=0, description="initial learning rate of Adam")
    decay: float = Field(0.999, gt=0, le=1, description="factor on the learning rate per step")
    restarts: int = Field(3, ge=1, le=20, description="trainings per row and fold; the one with the least loss is kept")
    correlation: Literal["kernel", "literal"] = Field(
        "kernel",
        description="correlation term of the second stage: through a kernel distribution function, or the paper's "
        "empirical count",
    )
    optuna_trials: int = Field(
        20, ge=1, description="Optuna trials of the target `tuning`; the first uses these settings"
    )
    rows: list[str] = Field([], description="names of the rows to estimate; empty for all rows of rows.csv")
    convergence_subsamples: int = Field(200, ge=2, description="subsamples per size of the convergence study")
    convergence_subsamples_fitted: int = Field(
        20, ge=0, description="number of those subsamples that train networks and control variates (paper: all 200)"
    )
    target_half_width: dict[str, float] = Field(
        {}, description="row name: target half-width of its calibrated interval"
    )
    max_3d: int | None = Field(
        None,
        ge=8,
        description="maximum number of 3D runs of a campaign that grows to reach `target_half_width`; null: no growth",
    )
    max_0d: int | None = Field(None, ge=16, description="maximum number of propagation runs; null: no growth")
    rounds: int = Field(5, ge=1, le=20, description="rounds of growth, each at most doubling the runs")
    convergence_rows: list[str] = Field(
        [], description="rows of the convergence study; empty for those whose 3D column is an OSI"
    )
    convergence_sizes: list[int] = Field(
        [25, 50, 100, 150, 200, 250, 300, 400], description="3D runs per subsample of the convergence study"
    )
    coverage_sizes: list[int] = Field([25, 50, 100, 250], description="pilot sizes of the target `coverage`")
    coverage_replicates: int = Field(400, ge=2, description="replicates per cell of the target `coverage`")
    min_3d: int = Field(20, ge=4, description="fewest usable 3D runs for any estimate")
