"""Settings of the bundled patient."""

from pydantic import BaseModel, ConfigDict, Field

from coronaryuq.case.case_json import Branch

MICROVASCULAR: dict[Branch, float] = {"LAD": 0.85, "LCx": 1.0, "RCA": 0.92}


class Settings(BaseModel):
    """The synthetic patient: heart rate, perfusion and disease of the microcirculation, resolution of the wall."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field("bundled", description="Name of the patient.")
    anatomy_seed: int = Field(2024, ge=0, description="Seed of the anatomy; the campaign's seed draws everything else.")
    cells: int = Field(30_000, ge=1000, description="Approximate number of cells of the left ventricular wall.")
    period: float = Field(1.0, gt=0.3, lt=2.0, description="Cardiac period, s.")
    mean_pressure: float = Field(94.0, gt=40, lt=160, description="Mean aortic pressure at rest, mmHg.")
    stroke_volume: float = Field(68.0, gt=20, lt=160, description="Stroke volume at rest, mL.")
    mbf: float = Field(2.35, gt=0.3, lt=6.0, description="Mean hyperaemic myocardial blood flow, mL/min/g.")
    microvascular: dict[Branch, float] = Field(
        default_factory=lambda: dict(MICROVASCULAR),
        description="Relative conductance per gram of each artery's beds; below 1 in microvascular disease.",
    )
    bed_spread: float = Field(
        0.10,
        ge=0,
        lt=0.5,
        description="Standard deviation of the logarithm of the beds' conductance per gram.",
    )
    texture: float = Field(
        0.06, ge=0, lt=0.3, description="Relative standard deviation of perfusion within a territory."
    )
    texture_length: float = Field(1.2, gt=0.1, description="Correlation length of perfusion within a territory, cm.")
    venous_share: float = Field(
        0.025, gt=0, lt=0.5, description="Fraction of a coronary bed's resistance at rest that is venous (Rv)."
    )
    hyperaemia: float = Field(
        0.24, gt=0, le=1, description="Factor on Ra and Ram under hyperaemia (paper, section 2.2)."
    )
