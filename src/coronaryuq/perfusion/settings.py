"""What the perfusion stage may be told: noise, its patterns, distances, number of realisations."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class DistanceNoise(BaseModel):
    """Gaussian noise on point-to-outlet distances: relative standard deviation of each pattern; variances add."""

    model_config = ConfigDict(extra="forbid")

    independent: float = Field(0.0, ge=0, lt=0.5, description="drawn anew for every point and outlet (1)")
    correlated: float = Field(0.0, ge=0, lt=0.5, description="a smooth field over the LV for every outlet (1)")
    outlet: float = Field(0.0, ge=0, lt=0.5, description="one factor per outlet, the same at every point (1)")


class FlowNoise(BaseModel):
    """Gaussian noise on myocardial blood flow: relative standard deviation of each pattern; variances add."""

    model_config = ConfigDict(extra="forbid")

    independent: float = Field(0.0, ge=0, lt=1, description="drawn anew for every point (1)")
    correlated: float = Field(0.0, ge=0, lt=1, description="a smooth field over the LV (1)")
    outlet: float = Field(0.0, ge=0, lt=1, description="one factor per outlet, on whatever is its territory (1)")
    scan: float = Field(0.0, ge=0, lt=1, description="one factor for the whole scan (1)")


class NoiseModel(BaseModel):
    """Where the noise of one realisation lies."""

    model_config = ConfigDict(extra="forbid")

    distance: DistanceNoise = Field(default_factory=DistanceNoise, description="noise of the distances")
    mbf: FlowNoise = Field(default_factory=FlowNoise, description="noise of the MBF map")


def _default_models() -> dict[str, NoiseModel]:
    return {
        "independent": NoiseModel(distance=DistanceNoise(independent=0.1), mbf=FlowNoise(independent=0.2)),
        "correlated": NoiseModel(distance=DistanceNoise(correlated=0.1), mbf=FlowNoise(correlated=0.2)),
        "outlet": NoiseModel(distance=DistanceNoise(correlated=0.1), mbf=FlowNoise(outlet=0.2)),
    }


class Settings(BaseModel):
    """Perfusion territories and the noise of their flows (paper, section 2.1)."""

    model_config = ConfigDict(extra="forbid")

    realisations: int = Field(2500, ge=2, description="noisy realisations of territories and MBF (paper: 2500)")
    models: dict[str, NoiseModel] = Field(
        default_factory=_default_models, min_length=1, description="noise models, all simulated and reported"
    )
    use: str = Field("outlet", description="the noise model whose covariance the posterior uses")
    branch_sd: float | None = Field(
        0.2, gt=0, lt=1,
        description="scale the covariance to this standard deviation of every outlet's flow, relative to its mean, "
        "keeping the simulated correlations (paper: 0.2); null takes the simulated covariance as it is (1)",
    )  # fmt: skip
    correlation_length: float = Field(
        1.0, gt=0, description="length l of the correlated patterns, correlation exp(-d^2 / 2 l^2) (cm)"
    )
    mean: Literal["baseline", "realisations"] = Field(
        "baseline", description="targets: flows without noise (paper), or the mean over realisations"
    )
    distance_to: Literal["outlet", "centreline"] = Field(
        "outlet",
        description="distance of an LV point to the outlet (paper) or to the centreline of the outlet's vessel",
    )
    radius_power: float = Field(
        0.0, ge=0, le=4, description="distances are divided by outlet radius to this power; 0 is unweighted (1)"
    )

    @model_validator(mode="after")
    def _use_is_a_model(self) -> "Settings":
        if self.use not in self.models:
            raise ValueError(f"use = {self.use!r} is not among the models {', '.join(self.models)}")
        return self
