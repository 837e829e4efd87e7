"""Settings of the perfusion stage: noise models, distances, number of realisations."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class DistanceNoise(BaseModel):
    """Gaussian noise on point-to-outlet distances: relative standard deviation of each pattern; variances add."""

    model_config = ConfigDict(extra="forbid")

    independent: float = Field(
        0.0, ge=0, lt=0.5, description="Relative standard deviation of noise per point and outlet."
    )
    correlated: float = Field(
        0.0, ge=0, lt=0.5, description="Relative standard deviation of a smooth field per outlet."
    )
    outlet: float = Field(0.0, ge=0, lt=0.5, description="Relative standard deviation of one factor per outlet.")


class FlowNoise(BaseModel):
    """Gaussian noise on myocardial blood flow: relative standard deviation of each pattern; variances add."""

    model_config = ConfigDict(extra="forbid")

    independent: float = Field(0.0, ge=0, lt=1, description="Relative standard deviation of noise per point.")
    correlated: float = Field(0.0, ge=0, lt=1, description="Relative standard deviation of a smooth field.")
    outlet: float = Field(0.0, ge=0, lt=1, description="Relative standard deviation of one factor per territory.")
    scan: float = Field(0.0, ge=0, lt=1, description="Relative standard deviation of one factor for the whole scan.")


class NoiseModel(BaseModel):
    """Noise of distances and of the MBF map."""

    model_config = ConfigDict(extra="forbid")

    distance: DistanceNoise = Field(default_factory=DistanceNoise, description="Noise of the distances to outlets.")
    mbf: FlowNoise = Field(default_factory=FlowNoise, description="Noise of the MBF map.")


def _default_models() -> dict[str, NoiseModel]:
    return {
        "independent": NoiseModel(distance=DistanceNoise(independent=0.1), mbf=FlowNoise(independent=0.2)),
        "correlated": NoiseModel(distance=DistanceNoise(correlated=0.1), mbf=FlowNoise(correlated=0.2)),
        "outlet": NoiseModel(distance=DistanceNoise(correlated=0.1), mbf=FlowNoise(outlet=0.2)),
    }


class Settings(BaseModel):
    """Perfusion territories and the noise of their flows (paper, section 2.1)."""

    model_config = ConfigDict(extra="forbid")

    realisations: int = Field(2500, ge=2, description="Number of noisy realisations (paper: 2500).")
    models: dict[str, NoiseModel] = Field(
        default_factory=_default_models,
        min_length=1,
        description="Noise models by name; all are reported.",
    )
    use: str = Field("outlet", description="Name of the noise model whose covariance the posterior uses.")
    branch_sd: float | None = Field(
        0.2, gt=0, lt=1,
        description="Standard deviation of every outlet's flow relative to its mean, to which the covariance is scaled "
        "with the simulated correlations (paper: 0.2); null keeps the simulated covariance.",
    )  # fmt: skip
    correlation_length: float = Field(
        1.0, gt=0, description="Length l of smooth noise with correlation exp(-d^2 / 2 l^2), cm."
    )
    mean: Literal["baseline", "realisations"] = Field(
        "baseline",
        description="Target flows: those without noise (`baseline`, paper) or their mean over `realisations`.",
    )
    distance_to: Literal["outlet", "centreline"] = Field(
        "outlet",
        description="Distance of an LV point: to the `outlet` (paper) or to the `centreline` of the outlet's vessel.",
    )
    radius_power: float = Field(
        0.0,
        ge=0,
        le=4,
        description="Power of the outlet radius by which distances are divided; 0: unweighted distances.",
    )

    @model_validator(mode="after")
    def _use_is_a_model(self) -> "Settings":
        if self.use not in self.models:
            raise ValueError(f"use = {self.use!r} is not among the models {', '.join(self.models)}")
        return self
