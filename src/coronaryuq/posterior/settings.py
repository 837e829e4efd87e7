"""Settings of the posterior stage: sampler, prior, constraint, emulator, independence steps, convergence, draws."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class DreamSettings(BaseModel):
    """The DREAM sampler (Vrugt et al. 2009)."""

    model_config = ConfigDict(extra="forbid")

    chains: int = Field(24, ge=6, description="Parallel chains (paper: 24).")
    generations: int = Field(10_000, ge=2, description="Proposals per chain, burn-in included (paper: 10000).")
    burn_in: float = Field(0.5, gt=0, lt=1, description="Fraction of the generations discarded (paper: 0.5).")
    pairs: int = Field(3, ge=1, le=5, description="Maximum number of pairs of chains in one proposal.")
    crossovers: int = Field(3, ge=1, le=20, description="Number n of crossover probabilities, 1/n to 1.")
    adapt_crossovers: bool = Field(
        True, description="Adapt how often each crossover probability is used, during burn-in."
    )
    unit_jump: float = Field(
        0.2, ge=0, lt=1, description="Probability of a jump rate of 1, which allows jumps between modes."
    )
    snooker: float = Field(0.0, ge=0, lt=1, description="Probability of a snooker update (ter Braak & Vrugt 2008).")
    spread: float = Field(0.05, ge=0, lt=1, description="Half-width b of the uniform e in the factor 1 + e of a jump.")
    jitter: float = Field(1e-6, gt=0, description="Standard deviation b* of the noise added to a jump.")
    remove_outliers: bool = Field(True, description="During burn-in, restart chains stuck at low density.")
    boundary: Literal["reflect", "fold", "reject"] = Field(
        "reflect",
        description="Handling of proposals outside the prior's bounds with `constraint: rescaled`; otherwise "
        "they are rejected.",
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

    use: bool = Field(
        True, description="Screen proposals with an emulator; the posterior remains that of the 0D model."
    )
    generations: int = Field(
        50,
        ge=1,
        description="Generations on the emulator between two decisions of the 0D model, where no independence steps "
        "are taken; 1: as in Christen & Fox (2005).",
    )
    design: int = Field(
        0,
        ge=0,
        description="Number of 0D runs to which the emulator is fitted; 0: twice the number of its coefficients.",
    )


class IndependenceSettings(BaseModel):
    """Independence steps: between two 0D runs a chain moves on the emulator until it has forgotten its last state."""

    model_config = ConfigDict(extra="forbid")

    use: bool = Field(
        True,
        description="Take independence steps if Pareto-smoothed importance sampling finds the emulator good enough; "
        "otherwise, or if false, DREAM runs with delayed acceptance.",
    )
    draws: int = Field(200, ge=20, description="Draws of each chain, burn-in included; each is one 0D run.")
    k_limit: float = Field(
        0.5,
        gt=0,
        le=1,
        description="Independence steps are taken if Pareto k of the pilot runs is below this, or if no ratio "
        "is twice their mean. Averages over the chains have a finite variance below 0.5.",
    )


class Settings(BaseModel):
    """Posterior of the outlet resistances (paper, section 2.3) and the samples drawn from it.

    `prior`, `constraint`, `scale_targets` and `scaling` are those of `uncertainty: paper`.
    """

    model_config = ConfigDict(extra="forbid")

    dream: DreamSettings = Field(default_factory=DreamSettings, description="The DREAM sampler.")
    emulator: EmulatorSettings = Field(
        default_factory=EmulatorSettings, description="Delayed acceptance with an emulator."
    )
    independence: IndependenceSettings = Field(
        default_factory=IndependenceSettings, description="Independence steps on the emulator."
    )
    prior: tuple[float, float] = Field(
        (0.5, 2.0), description="Bounds of the uniform prior of each multiplier of r-hat, with `uncertainty: paper`."
    )
    constraint: Literal["conditioned", "rescaled"] = Field(
        "conditioned",
        description="Total resistance of the LV-perfusing beds, with `uncertainty: paper`: `conditioned` samples the "
        "prior given that total, `rescaled` rescales states after acceptance as the paper does, which changes the "
        "stationary distribution.",
    )
    scale_targets: bool = Field(
        True,
        description="Scale target flows and covariance such that their total is the model's LV flow at r-hat, with "
        "`uncertainty: paper`.",
    )
    cycle_tolerance: float = Field(
        1e-4, gt=0, description="Relative cycle-to-cycle error at which a 0D run counts as periodic."
    )
    steps_per_cycle: int | None = Field(
        None, ge=50, description="0D time steps per cycle; null: as in the network file."
    )
    checkpoint: int = Field(
        500,
        ge=1,
        description="Generations between checkpoints; with independence steps, a draw counts as "
        "`emulator.generations`.",
    )
    rhat_limit: float = Field(
        1.01, gt=1, description="Largest rank-normalised split R-hat of converged chains (paper: 1.1)."
    )
    ess_limit: float = Field(
        400.0, gt=0, description="Smallest bulk and tail effective sample size of converged chains."
    )
    draws: int = Field(
        10_000,
        ge=10,
        description="Maximum number of thinned draws in the table of draws, of each part as long as the first chains.",
    )
    scaling: tuple[float, float] = Field(
        (0.7, 1.25),
        description="Bounds of s, the uniformly distributed scaling of total coronary resistance (paper, 2.3), with "
        "`uncertainty: paper`.",
    )

    @model_validator(mode="after")
    def _ranges(self) -> "Settings":
        if not 0 < self.prior[0] < 1 < self.prior[1]:
            raise ValueError(f"prior = {self.prior} must enclose 1")
        if not 0 < self.scaling[0] < self.scaling[1]:
            raise ValueError(f"scaling = {self.scaling} must be positive and increasing")
        return self
