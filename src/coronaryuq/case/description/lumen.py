"""How well the lumen is known: the error of its segmentation, as `case.yaml` states it."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from coronaryuq.core.units import MM

NotNegative = Annotated[float, Field(ge=0)]


class CalcifiedStretch(BaseModel):
    """A stretch of a vessel whose wall is calcified, cm along the vessel."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    vessel: str = Field(description="Vessel of the tree.")
    start: float = Field(ge=0, description="Start of the stretch, cm along the vessel.")
    end: float = Field(gt=0, description="End of the stretch, cm along the vessel.")

    @model_validator(mode="after")
    def _forward(self):
        if self.end <= self.start:
            raise ValueError("end must be greater than start")
        return self


class LumenError(BaseModel):
    """Error of the segmented radius along every coronary centreline.

    The true radius has a lognormal law whose mean is the segmented radius plus `bias`. Its error consists of a part
    that all coronary arteries share (threshold, reader, scanner) and a part that is correlated along each artery.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    unit: Literal["voxel", "mm"] = Field("voxel", description="Unit of `bias`, `common_sd` and `local_sd`.")
    voxel: float = Field(0.35, gt=0, le=2, description="Width of a voxel of the angiogram, mm; usually 0.2 to 0.4.")
    bias: float = Field(
        0.0,
        ge=-2,
        le=2,
        description="Mean of the true minus the segmented radius. Studies against intravascular ultrasound disagree on "
        "the sign: pooled, angiograms overestimate the smallest area by some 7 % (Fischer et al. 2013), and behind "
        "calcium they underestimate it.",
    )
    common_sd: NotNegative = Field(
        0.15, description="Standard deviation of the radius error that all coronary arteries share."
    )
    local_sd: NotNegative = Field(
        0.30,
        description="Standard deviation of the radius error that is correlated along each artery. With the default of "
        "`common_sd`, 0.12 mm in all at 0.35 mm voxels, or 0.23 mm of diameter: readers' lumens lie a quarter of a "
        "millimetre apart (Kirisli et al. 2013).",
    )
    length: float = Field(
        5.0,
        gt=0,
        le=100,
        description="Length over which the local error is correlated (to 1/e), mm: some ten voxels, about the spacing "
        "of the cross-sections that a reader corrects.",
    )
    narrow: float = Field(
        1.0,
        ge=0,
        le=10,
        description="Additional local standard deviation in a stenosis, per fraction of the radius that is lost there: "
        "with 1, half as much again where the diameter is halved.",
    )
    calcified: list[CalcifiedStretch] = Field(
        default_factory=list, description="Stretches with calcified walls, whose blooming blurs the lumen."
    )
    calcium: float = Field(
        1.0, ge=0, le=10, description="Additional local standard deviation in calcified stretches: with 1, doubled."
    )

    @property
    def scale(self) -> float:
        """Length of one `unit` in cm."""
        return MM * (self.voxel if self.unit == "voxel" else 1.0)
