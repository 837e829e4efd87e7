"""Errors of routine measurements: cuff, echocardiogram, perfusion map, blood and assumed numbers."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Relative = Annotated[float, Field(ge=0, le=1)]


class RoutineErrors(BaseModel):
    """Standard deviations of what is measured on every patient besides images, and of what is assumed.

    The heart rate is not among them: an electrocardiogram gives it to a per cent, and samples in 3D share one period.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    pressure: float = Field(
        6.0,
        ge=0,
        le=40,
        description="Standard deviation of each aortic pressure from the cuff, mmHg: validated devices may have 8 mmHg "
        "(ISO 81060-2), less over repeated readings.",
    )
    pressure_correlation: float = Field(
        0.7,
        ge=0,
        le=0.99,
        description="Correlation of the errors of two aortic pressures: cuff and transfer are shared.",
    )
    stroke_volume: Relative = Field(
        0.12, description="Relative standard deviation of stroke volume by echocardiography (Lang et al. 2015)."
    )
    ventricular_volume: Relative = Field(
        0.12, description="Relative standard deviation of end-diastolic and end-systolic volume (Wood et al. 2014)."
    )
    ejection_fraction: Relative = Field(
        0.05, description="Standard deviation of the ejection fraction (Thavendiranathan et al. 2013)."
    )
    coronary_share: Relative = Field(
        0.25, description="Relative standard deviation of the coronary fraction of cardiac output (literature value)."
    )
    mbf_calibration: Relative = Field(
        0.10,
        description="Relative standard deviation of one factor on the whole perfusion map (scanner, kinetic model, "
        "extraction fraction): repeated scans in one session differ by 10 % (Kitkungvan et al. 2017).",
    )
    registration: float = Field(
        3.0,
        ge=0,
        le=30,
        description="Standard deviation of the map's place relative to the anatomy in each direction, mm: about a "
        "voxel of a nuclear image, several of a CT's.",
    )
    hyperaemia: Relative = Field(
        0.15,
        description="Relative standard deviation of coronary resistance at hyperaemia over rest, between patients "
        "(Wilson et al. 1990).",
    )
    microvascular: Relative = Field(
        0.25,
        description="Standard deviation of the logarithm of hyperaemic conductance per gram of myocardium, between the "
        "beds of one heart. A convention: regional hyperaemic flow of healthy hearts varies by 10 to 25 %.",
    )
    microvascular_correlation: float = Field(
        0.5,
        ge=0,
        le=0.99,
        description="Correlation of the conductances per gram of two beds of one artery. A convention: half of what "
        "differs is regional.",
    )
    viscosity: Relative = Field(
        0.10,
        description="Relative standard deviation of viscosity: haematocrits of 0.36 to 0.50 differ by some 30 % "
        "(Pries et al. 1992).",
    )
    tissue_density: Relative = Field(
        0.01,
        description="Relative standard deviation of the density of myocardium (Vinnakota & Bassingthwaighte 2004).",
    )
    murray_exponent: float = Field(
        0.2,
        ge=0,
        le=1,
        description="Standard deviation of the exponent by which flow is divided among outlets that do not perfuse the "
        "left ventricle; published values are 2 to 3 (Zhou et al. 1999; Murray 1926).",
    )
