"""Settings of the discrepancy search."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from coronaryuq.zerod.effects.names import EFFECTS

if TYPE_CHECKING:
    EffectName = str
else:
    EffectName = Literal[EFFECTS]

CASES = ("case", "hidden", "pairs", "benchmark")
"""Result folders, which are not allowed as names of animals."""
GIVEN = ("campaign", "open_loop")
"""Networks of the benchmark that are not read from a file."""


class Benchmark(BaseModel):
    """Synthetic cases with known hidden effects, for the target `discrepancy_benchmark`."""

    model_config = ConfigDict(extra="forbid")

    networks: list[str] = Field(
        ["campaign", "open_loop"],
        min_length=1,
        description="Networks to hide effects in: `campaign`, the tuned loop of this campaign; `open_loop`, a bundled "
        "coronary tree driven by measured pressure; or a svZeroDSolver JSON file of any tuned loop.",
    )
    seeds: int = Field(2, ge=1, description="Number of repetitions of every benchmark cell, one job each.")
    first_seed: int = Field(1, ge=0, description="Seed of the first repetition; the others count up from it.")

    @property
    def all_seeds(self) -> range:
        """Seeds of the repetitions."""
        return range(self.first_seed, self.first_seed + self.seeds)

    @property
    def named(self) -> dict[str, str]:
        """Network by the name used in folders and tables: for a file, its name without the suffix."""
        return {Path(network).stem: network for network in self.networks}

    @model_validator(mode="after")
    def _check_names(self) -> "Benchmark":
        if len(self.named) < len(self.networks):
            raise ValueError(f"networks {self.networks} share a name; rename one of the files")
        for name in self.named:
            if not re.fullmatch(r"\w[\w.-]*", name):
                raise ValueError(f"networks: {name!r} is not a valid folder name; rename the file")
        return self


class Settings(BaseModel):
    """Settings of the search for missing effects; `sd_...` are prior standard deviations of logarithms."""

    model_config = ConfigDict(extra="forbid")

    model: str | None = Field(
        None, description="Network to examine, svZeroDSolver JSON; if omitted, the tuned loop of this campaign."
    )
    measurements: str | None = Field(
        None,
        description="Measurement table; if omitted, that of the case. Without one, an effect is hidden in the bundled "
        "patient's loop to test the search; nothing is hidden for any other patient.",
    )
    conditions: str | None = Field(None, description="Conditions file for `measurements`.")
    pairs: tuple[str, str] | None = Field(
        None,
        description="Search a table model: a table of simulated and a table of measured outputs, joined on the column "
        "`sample`.",
    )
    recordings: str | None = Field(None, description="Folder of `ANIMAL_CONDITION.csv`: flow driven by pressures.")
    animals: list[str] = Field(default_factory=list, description="Animals of `recordings`, each searched by itself.")
    held_out: list[str] | None = Field(
        None,
        description="Conditions of `recordings` held out of every fit; if omitted, those whose names end in `dob...`.",
    )
    free_bed: bool = Field(
        False,
        description="Calibrate the shape of the bed of `recordings`, and a stenosis of unknown severity in each "
        "condition named `...sten...`.",
    )
    in_report: bool | None = Field(
        None,
        description="Include the search in the campaign and its report; default: if there are measurements of the "
        "patient.",
    )
    adopt: bool = Field(
        False,
        description="Adopt the effects that the search of the patient's measurements (of the bundled patient: of the "
        "hidden case) names and confirms on data held out: calibration, posterior, runs and estimates use the network "
        "with them, their sizes uncertain as the search found them.",
    )
    benchmark: Benchmark = Field(default_factory=Benchmark, description="Benchmark on hidden effects.")
    hidden_effect: EffectName = Field(
        "quadratic_stenosis", description="Effect to hide in the bundled patient's loop if no measurements are given."
    )
    hidden_size: float = Field(1.0, description="Size of the hidden effect, in prior standard deviations.")
    pressure_unit: Literal["auto", "dyn/cm2", "mmHg", "Pa", "kPa"] = Field(
        "auto",
        description="Pressure unit of the network; `auto` chooses dyn/cm2 or mmHg from the simulated root pressure.",
    )
    noise: Literal["estimated", "stated"] = Field(
        "estimated",
        description="Noise of waveforms: `stated` uses the standard deviations of the table; `estimated` also "
        "considers other scales and correlation times, by the scatter of the waveforms.",
    )
    alarm_level: float = Field(0.01, gt=0, lt=1, description="Significance level of the global test.")
    false_discovery_rate: float = Field(0.05, gt=0, lt=1, description="False discovery rate of located misfits.")
    model_floor: float = Field(
        0.003,
        ge=0,
        description="Numerical error of the model as a fraction of each series' largest value, added to its standard "
        "deviation.",
    )
    shortlist: int = Field(10, ge=1, description="Candidates fitted per round, the most promising by their estimates.")
    max_effects: int = Field(3, ge=0, description="Maximum number of effects that may be added.")
    min_log_odds: float = Field(
        3.0,
        ge=0,
        description="Log evidence plus log prior by which a second or third effect, or its class of indistinguishable "
        "effects, must exceed the log evidence of the model before it; 3 are odds of 20 to 1. A first effect only has "
        "to exceed it, and is then weighed against nothing and something else by all data.",
    )
    starts: int = Field(3, ge=1, le=6, description="Starting sizes of a candidate's fit.")
    iterations: int = Field(12, ge=1, description="Maximum number of Gauss-Newton iterations per fit.")
    steps_per_cycle: int = Field(300, ge=50, description="Time steps per cardiac cycle of the 0D runs.")
    threads: int = Field(1, ge=1, description="Threads of the 0D solver.")
    sd_bed: float = Field(0.15, gt=0, description="Prior sd of the log resistance of each bed.")
    sd_coronary: float = Field(0.25, gt=0, description="Prior sd of the log resistance of all coronary beds together.")
    sd_compliance: float = Field(0.25, gt=0, description="Prior sd of the log compliance of all beds together.")
    sd_bed_compliance: float = Field(0.15, gt=0, description="Prior sd of the log compliance of each bed.")
    sd_bed_shape: float = Field(
        0.5,
        gt=0,
        description="Prior sd, where a condition lists `bed_shape` under `free`, of the log proximal resistance and "
        "log proximal compliance of the beds and of the log compliance of the vessels.",
    )
    sd_stenosis: float = Field(
        2.0,
        gt=0,
        description="Prior sd of the log loss coefficient of a stenosis listed under `stenosis`, about the value that "
        "`set` gives it.",
    )
    sd_systemic: float = Field(0.2, gt=0, description="Prior sd of the log systemic resistance and compliance.")
    sd_heart: float = Field(0.15, gt=0, description="Prior sd of the log left ventricular elastance.")
    sd_blood: float = Field(0.1, gt=0, description="Prior sd of the log stressed blood volume of a closed loop.")
    sd_condition: float = Field(
        0.1,
        gt=0,
        description="Prior sd of the log coronary resistance of a condition, and of other factors by which it scales "
        "blocks, about the values given in the conditions file.",
    )
    sd_free: float = Field(1.0, gt=0, description="Prior sd of the log coronary resistance where a condition frees it.")

    @model_validator(mode="after")
    def _check_inputs(self) -> "Settings":
        files = (self.model, self.measurements, self.conditions)
        if self.measurements and not self.conditions:
            raise ValueError("measurements need a conditions file; give conditions")
        if (self.model or self.conditions) and not self.measurements:
            raise ValueError(f"model and conditions need measurements, got {files}; give measurements")
        if self.adopt and self.model:
            raise ValueError("adopt applies to the campaign's own loop; leave out model")
        if bool(self.recordings) != bool(self.animals):
            raise ValueError("recordings and animals belong together; give both or neither")
        if self.free_bed and not self.recordings:
            raise ValueError("free_bed applies to recordings only; use `free` in the conditions file instead")
        if self.held_out is not None and not self.recordings:
            raise ValueError("held_out applies to recordings only; use `held_out` in the conditions file instead")
        for number, animal in enumerate(self.animals):
            if not re.fullmatch(r"\w[\w .-]*", animal) or animal in CASES or animal in self.animals[:number]:
                raise ValueError(f"animals: {animal!r} is an invalid or duplicate folder name; give each its own")
        return self
