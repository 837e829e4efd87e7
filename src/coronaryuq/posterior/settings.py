"""Settings of the posterior stage: sampler, prior, constraint, emulator, verdict, draws."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class DreamSettings(BaseModel):
    """The DREAM sampler (Vrugt et al. 2009)."""

    model_config = ConfigDict(extra="forbid")

    chains: int = Field(24, ge=6, description="parallel chains (paper: 24)")
    generations: int = Field(10_000, ge=2, description="proposals per chain, burn-in included (paper: 10000)")
    burn_in: float = Field(0.5, gt=0, lt=1, description="fraction of the generations discarded (paper: 0.5)")
    pairs: int = Field(3, ge=1, le=5, description="maximum number of pairs of chains in one proposal")
    crossovers: int = Field(3, ge=1, le=20, description="number n of crossover probabilities, 1/n to 1")
    adapt_crossovers: bool = Field(
        True, description="adapt how often each crossover probability is used, during burn-in"
    )
    unit_jump: float = Field(
        0.2, ge=0, lt=1, description="probability of jump rate 1, which allows jumps between modes"
    )
    snooker: float = Field(0.0, ge=0, lt=1, description="probability of a snooker update (ter Braak & Vrugt 2008)")
    spread: float = Field(0.05, ge=0, lt=1, description="half-width b of the uniform e in the factor 1 + e of a jump")
    jitter: float = Field(1e-6, gt=0, description="standard deviation b* of the noise added to a jump")
    remove_outliers: bool = Field(True, description="during burn-in, restart chains stuck at low density")
    boundary: Literal["reflect", "fold", "reject"] = Field(
        "reflect",
        description="handling of proposals outside the prior's box with `constraint: rescaled`; else they are rejected",
    )

    @model_validator(mode="after")
    def _enough_partners(self) -> "DreamSettings":
        if self.chains % 2:
            raise ValueError(f"chains = {self.chains} must be even, because two halves take turns")
        if self.chains // 2 < max(2 * self.pairs, 3):
            raise ValueError(f"pairs = {self.pairs} needs at least {4 * self.pairs} chains, there are {self.chains}")
        return self


class EmulatorSettings(BaseModel):
    """Delayed acceptance: an emulator of outlet flows screens proposals, the 0D model decides."""

    model_config = ConfigDict(extra="forbid")

    use: bool = Field(True, description="screen proposals with an emulator; the posterior remains that of the 0D model")
    generations: int = Field(
        50, ge=1, description="generations on the emulator between two decisions of the 0D model; 1: as Christen & Fox"
    )
    design: int = Field(0, ge=0, description="0D runs to fit the emulator to; 0: twice the number of its coefficients")


class Settings(BaseModel):
    """Posterior of the outlet resistances (paper, section 2.3) and the samples drawn from it."""

    model_config = ConfigDict(extra="forbid")

    dream: DreamSettings = Field(default_factory=DreamSettings, description="the sampler")
    emulator: EmulatorSettings = Field(default_factory=EmulatorSettings, description="delayed acceptance")
    prior: tuple[float, float] = Field((0.5, 2.0), description="uniform prior of each multiplier of r-hat (1)")
    constraint: Literal["conditioned", "rescaled"] = Field(
        "conditioned",
        description="total resistance of the LV-perfusing beds: `conditioned` samples the prior given that total, "
        "`rescaled` rescales states after acceptance as the paper does, which changes the stationary distribution",
    )
    scale_targets: bool = Field(
        True, description="scale target flows and covariance such that their total is the model's LV flow at r-hat"
    )
    cycle_tolerance: float = Field(1e-4, gt=0, description="relative cycle-to-cycle error of a 0D run (1)")
    steps_per_cycle: int | None = Field(
        None, ge=50, description="0D time steps per cycle; null: as in the network file"
    )
    checkpoint: int = Field(500, ge=1, description="generations between two checkpoints")
    rhat_limit: float = Field(1.01, gt=1, description="converged below this rank-normalised split R-hat (paper: 1.1)")
    ess_limit: float = Field(400.0, gt=0, description="converged above this bulk and tail effective sample size")
    draws: int = Field(10_000, ge=10, description="maximum number of thinned draws in the table of draws")
    scaling: tuple[float, float] = Field(
        (0.7, 1.25),
        description="bounds of s, the uniformly distributed scaling of total coronary resistance (paper, 2.3)",
    )

    @model_validator(mode="after")
    def _ranges(self) -> "Settings":
        if not 0 < self.prior[0] < 1 < self.prior[1]:
            raise ValueError(f"prior = {self.prior} must enclose 1")
        if not 0 < self.scaling[0] < self.scaling[1]:
            raise ValueError(f"scaling = {self.scaling} must be positive and increasing")
        return self
