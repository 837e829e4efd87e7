"""Settings of calibration: the search for the 36 parameters of the closed loop."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Tuning of the closed loop by Nelder-Mead, from many starts at once, one block of parameters after the other."""

    model_config = ConfigDict(extra="forbid")

    candidates: int = Field(
        64, ge=1, description="Number of random parameter sets tried first; the best become starting points."
    )
    sampling_width: float = Field(
        0.5, gt=0, le=1, description="Width of the candidates' box, as a fraction of each parameter's range."
    )
    starts: int = Field(
        12,
        ge=1,
        description="Number of parallel Nelder-Mead searches; up to sixteen cost the 0D engine as much as one.",
    )
    least_squares_steps: int = Field(
        6, ge=0, description="Least-squares steps from every start at the beginning of a round; 0: none."
    )
    least_squares_cycles: int = Field(6, ge=1, description="Cardiac cycles of a loop run in the least-squares steps.")
    rounds: int = Field(3, ge=1, description="Number of rounds over the parameter blocks.")
    evaluations_per_parameter: int = Field(
        6, ge=2, description="Maximum number of loop runs of one search, per parameter of its block."
    )
    final_nelder_mead: int = Field(
        0,
        ge=0,
        description="Maximum number of loop runs per parameter of a final search over all 36 parameters; 0: none.",
    )
    regularisation: float = Field(
        0.2,
        ge=0,
        description="Cost of moving a parameter from its initial value over its whole range; with `uncertainty: full` "
        "it has a prior instead.",
    )
    steps_per_cycle: int = Field(250, ge=50, description="Time steps per cycle of a loop run during the search.")
    first_cycles: int = Field(
        12, ge=1, description="Cardiac cycles of a candidate's first run, from the initial condition."
    )
    cycles: int = Field(
        4, ge=1, description="Cardiac cycles of a run in the search, from the state of the best parameters so far."
    )
    final_steps_per_cycle: int = Field(1000, ge=100, description="Time steps per cycle of the tuned loop.")
    periodicity: float = Field(
        1e-4, gt=0, description="Relative cycle-to-cycle error at which the tuned loop counts as periodic."
    )
    hyperaemic_total: bool = Field(
        True,
        description="Choose the venous fraction of coronary resistance such that the total hyperaemic flow of the "
        "LV-perfusing outlets is that of the perfusion map; if false, only the waveform targets determine it.",
    )
    units: Literal["auto", "cgs", "mmHg"] = Field(
        "auto", description="Pressure unit of a network given in the case: dyn/cm2 (cgs) or mmHg; auto: by range."
    )
