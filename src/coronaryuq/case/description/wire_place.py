"""A place at which FFR was read by a pressure wire, or shall be predicted, as `case.yaml` states it."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from coronaryuq.case.case_json import Artery, Point


class WirePlace(BaseModel):
    """A place in a coronary artery, by its distance from the ostium or by a point."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}$")] | None = Field(
        None, description="Name in tables and in the report; default: vessel and distance, such as `LAD 6.5 cm`."
    )
    artery: Artery | None = Field(None, description="Artery (LM, LAD, LCx or RCA), with `distance`.")
    distance: float | None = Field(
        None,
        ge=0,
        description="cm along the centreline from the ostium to the wire's sensor, on the artery's course to its own "
        "end; of LAD and LCx from the left ostium, the left main included.",
    )
    point: Point | None = Field(
        None,
        description="A point near the place, in the anatomy's length unit: of a side branch the only way to name it.",
    )
    measured: float | None = Field(
        None, gt=0, le=1.2, description="FFR that was measured there, for comparison; it does not change the model."
    )
    sd: float | None = Field(
        None,
        gt=0,
        le=0.2,
        description="Standard deviation of that reading's own error (drift, repeatability); without it, the prediction "
        "is compared as if the reading were exact.",
    )

    @model_validator(mode="after")
    def _one_way(self):
        by_distance = self.artery is not None and self.distance is not None
        if by_distance == (self.point is not None) or (self.artery is None) != (self.distance is None):
            raise ValueError("give artery and distance (cm from the ostium), or point")
        if self.sd is not None and self.measured is None:
            raise ValueError("give sd only with measured")
        return self
