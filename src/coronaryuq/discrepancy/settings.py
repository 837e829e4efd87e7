"""Settings of the discrepancy search."""

import re
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

EffectName = Literal[
    "quadratic_stenosis",
    "stenosis_with_friction",
    "diffuse_narrowing",
    "collateral",
    "side_branch_leak",
    "epicardial_compliance",
    "inertance",
    "intramyocardial_pressure",
    "intramyocardial_delay",
    "compressed_resistance",
    "back_pressure",
    "autoregulation",
    "incomplete_hyperaemia",
    "ostial_loss",
    "bifurcation_loss",
    "haematocrit",
    "aortic_stenosis",
    "aortic_regurgitation",
    "mbf_underestimation",
    "shifted_territory",
    "rotated_territories",
    "pressure_offset",
    "shared_offset",
    "pressure_gain",
    "pressure_delay",
    "flow_gain",
    "flow_delay",
    "trigger_delay",
    "drive_gain",
    "exchanged_outlets",
]
"""What can be hidden: names of the library, which is not imported because reading settings costs nothing."""

CASES = ("case", "hidden", "pairs", "benchmark")
"""Folders of cases that are no animal."""
GIVEN = ("campaign", "open_loop")
"""Networks of the benchmark that are no file."""


class Benchmark(BaseModel):
    """Effects hidden on purpose, for the target `discrepancy_benchmark`."""

    model_config = ConfigDict(extra="forbid")

    networks: list[str] = Field(
        ["campaign", "open_loop"],
        min_length=1,
        description="what they are hidden in: `campaign`, its tuned loop; `open_loop`, a bundled tree under measured "
        "pressure; or a file, any tuned loop as svZeroDSolver JSON",
    )
    seeds: int = Field(2, ge=1, description="repetitions of every cell; one job each")
    first_seed: int = Field(1, ge=0, description="first of the seeds, which go on from it")

    @property
    def named(self) -> dict[str, str]:
        """Networks by the names of their folders and table lines: a file's is its name without the ending."""
        return {Path(one).stem: one for one in self.networks}

    @model_validator(mode="after")
    def _apart(self) -> "Benchmark":
        if len(self.named) < len(self.networks):
            raise ValueError(f"networks {self.networks} share a name; give files names of their own")
        for name in self.named:
            if not re.fullmatch(r"\w[\w.-]*", name):
                raise ValueError(f"networks: {name!r} is no name of a folder; rename the file")
        return self


class Settings(BaseModel):
    """How the search for a missing effect runs. Priors are standard deviations of logarithms unless said otherwise."""

    model_config = ConfigDict(extra="forbid")

    model: str | None = Field(
        None, description="network to examine, svZeroDSolver JSON; none: the tuned loop of this campaign"
    )
    measurements: str | None = Field(
        None, description="measurement table; none: made here, with `hidden_effect` somewhere in the tuned loop"
    )
    conditions: str | None = Field(None, description="conditions file that goes with `measurements`")
    pairs: tuple[str, str] | None = Field(
        None, description="a table model instead: tables of simulated and of measured outputs, rows joined by `sample`"
    )
    recordings: str | None = Field(
        None, description="folder of recordings `ANIMAL_CONDITION.csv`: flow of one artery under measured pressures"
    )
    animals: list[str] = Field(default_factory=list, description="animals of `recordings`; one search each")
    held_out: list[str] | None = Field(
        None, description="conditions of `recordings` that enter no fit; none: those whose names end in `dob...`"
    )
    free_bed: bool = Field(
        False,
        description="whether the bed of `recordings` is of unknown shape, and those named `...sten...` have a stenosis "
        "of unknown severity each",
    )
    in_report: bool = Field(False, description="whether the whole campaign and its report include the search")
    benchmark: Benchmark = Field(default_factory=Benchmark, description="effects hidden on purpose")
    hidden_effect: EffectName = Field("quadratic_stenosis", description="effect hidden where no measurements are given")
    hidden_size: float = Field(1.0, description="its size, in prior standard deviations")
    pressure_unit: Literal["auto", "dyn/cm2", "mmHg", "Pa", "kPa"] = Field(
        "auto", description="pressure unit of the network; auto: by its simulated root pressure, dyn/cm2 or mmHg"
    )
    noise: Literal["estimated", "said"] = Field(
        "estimated",
        description="of waveforms; estimated: where something is missing and they scatter otherwise than their sd say, "
        "as large as they scatter, or lasting, if that foretells held-out measurements better",
    )
    alarm_level: float = Field(0.01, gt=0, lt=1, description="significance level of the global test")
    false_discovery_rate: float = Field(
        0.05, gt=0, lt=1, description="false-discovery rate of the located disagreements"
    )
    model_floor: float = Field(
        0.003,
        ge=0,
        description="numerical error of the model, as a share of each series' largest value, added to the sd",
    )
    shortlist: int = Field(
        10, ge=1, description="candidates fitted per round, after the score test of all; those that compete in full"
    )
    max_effects: int = Field(3, ge=0, description="effects that may be added at most")
    least_log_odds: float = Field(
        3.0,
        ge=0,
        description="log evidence, with its share of the prior, by which an effect or its class must exceed the "
        "present model's; 3 are posterior odds of 45 to 1",
    )
    starts: int = Field(3, ge=1, le=6, description="starting sizes of an effect per fit, six at most")
    iterations: int = Field(12, ge=1, description="Gauss-Newton iterations of a fit at most")
    steps_per_cycle: int = Field(300, ge=50, description="time steps per cycle of the 0D runs")
    threads: int = Field(1, ge=1, description="threads of the 0D engine")
    sd_bed: float = Field(0.15, gt=0, description="resistance of each bed")
    sd_coronary: float = Field(0.25, gt=0, description="resistance of all coronary beds together")
    sd_compliance: float = Field(0.25, gt=0, description="compliance of all coronary beds together")
    sd_bed_compliance: float = Field(0.15, gt=0, description="compliance of each bed")
    sd_bed_shape: float = Field(
        0.5,
        gt=0,
        description="where a condition lists `bed_shape` under `free`: the share of the proximal bed in resistance and "
        "in compliance, compliance of the vessels, each",
    )
    sd_stenosis: float = Field(
        2.0, gt=0, description="loss of a stenosis that conditions list under `stenosis`, about what `set` says of it"
    )
    sd_systemic: float = Field(0.2, gt=0, description="systemic resistance, systemic compliance, each")
    sd_heart: float = Field(0.15, gt=0, description="left ventricular elastance")
    sd_condition: float = Field(0.1, gt=0, description="coronary resistance of a condition beside what it declares")
    sd_free: float = Field(1.0, gt=0, description="coronary resistance of a condition that lists it under `free`")

    @model_validator(mode="after")
    def _given_whole(self) -> "Settings":
        files = (self.model, self.measurements, self.conditions)
        if self.measurements and not self.conditions:
            raise ValueError("measurements want their conditions file; give conditions")
        if (self.model or self.conditions) and not self.measurements:
            raise ValueError(f"model and conditions want measurements, not {files}; give measurements")
        if bool(self.recordings) != bool(self.animals):
            raise ValueError("recordings and animals go together; give both or neither")
        if self.free_bed and not self.recordings:
            raise ValueError("free_bed is of recordings; say it in the conditions file of other measurements")
        if self.held_out is not None and not self.recordings:
            raise ValueError("held_out is of recordings; say it in the conditions file of other measurements")
        for number, animal in enumerate(self.animals):
            if not re.fullmatch(r"\w[\w .-]*", animal) or animal in CASES or animal in self.animals[:number]:
                raise ValueError(f"animals: {animal!r} is no name of a folder, or taken; give each animal its own")
        return self
