"""`case.json`: the checked case that the case stage writes and every later stage reads."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.settings import MURRAY_EXPONENT
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.typed import checked

Branch = Literal["LAD", "LCx", "RCA"]
Artery = Literal["LM", "LAD", "LCx", "RCA"]
Tissue = Literal["LV", "RV", "septum"]
Dominance = Literal["right", "left", "co"]
"""The artery that feeds the back of the heart: the right one, the circumflex, or both."""
AnatomyKind = Literal["centrelines", "surface", "simvascular", "mesh"]
Stop = Literal["end", "branch", "stenosis"]
"""What keeps the place of FFR nearer to its stenosis than asked."""
Positive = Annotated[float, Field(gt=0)]
Point = tuple[float, float, float]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


class AnatomySource(_Part):
    """Kind of files from which the vessels were read, and the length unit of these files."""

    kind: AnatomyKind
    unit: str


class Aorta(_Part):
    """0D location of the aortic pressure, as svZeroDSolver names it; made: the aorta is none of the patient's."""

    pressure: str
    made: bool = False


class CaseOutlet(_Part):
    """A coronary outlet: its position (cm), its 0D boundary condition and block, and the wall that it perfuses."""

    name: str
    label: str
    bc: str
    vessel: str
    block: str
    perfuses: Tissue
    branch: Branch
    point: Point
    radius: Positive


class FfrPlace(_Part):
    """Where FFR of a stenosis is read: at `arc` (cm along its vessel); `asked`: distance (cm) asked beyond its end.

    stop: what kept the place nearer than that, if anything did: the vessel's end, its branching, or the next stenosis.
    """

    arc: float
    asked: float
    stop: Stop | None = None


class CaseStenosis(_Part):
    """A stenosis: its artery, its tree vessel and extent (cm along it), its 0D vessels, and the 0D locations around it.

    `start` and `end` are None for a stenosis that is known only as a 0D block. `ffr` is the location distal to it,
    `flow` its inlet, `root` the inlet of the branch's first vessel, and `outlet` the boundary condition whose flow
    predicts its wall shear stress. `read` is None where 0D reads FFR at its end, 3D as the mesh settings say.
    """

    name: str
    artery: Artery
    vessel: str
    segment: str
    proximal: str | None
    distal: str | None
    area_ratio: Positive | None
    start: float | None
    end: float | None
    ffr: str
    flow: str
    root: str
    outlet: str
    read: FfrPlace | None = None


class CaseWirePlace(_Part):
    """A place of a pressure wire: `arc` (cm along its tree vessel) and `distance` (cm from the ostium).

    artery: that of the vessel. measured: FFR that was read there, with the standard deviation `sd` of its own error.
    """

    name: str
    artery: str
    vessel: str
    arc: float
    distance: float
    measured: Positive | None = None
    sd: Positive | None = None


class TargetValue(_Part):
    """A clinical target; `value` is None if it was not measured."""

    description: str | None = None
    value: float | None
    unit: str | None = None


class CaseSummary(_Part):
    """The content of `case.json`: blood (g/cm3, P), period (s), tissue density (g/mL), and all places by name."""

    name: str
    description: str
    period: Positive
    density: Positive
    viscosity: Positive
    haematocrit: float | None
    hyperaemia: Positive
    tissue_density: Positive
    murray_exponent: Positive = MURRAY_EXPONENT
    schematic: bool
    anatomy: AnatomySource | None
    aorta: Aorta
    outlets: list[CaseOutlet] = Field(min_length=1)
    systemic: list[str]
    stenoses: list[CaseStenosis]
    ffr_at: list[CaseWirePlace] = []
    dominance: Dominance | None = None
    targets: dict[str, TargetValue]
    errors: RoutineErrors | None = None
    notes: list[str]

    @property
    def lv_outlets(self) -> list[CaseOutlet]:
        """Outlets that perfuse the left ventricle."""
        return [outlet for outlet in self.outlets if outlet.perfuses == "LV"]


def read_case(path: str | Path) -> CaseSummary:
    """Read `case.json`.

    Raises
    ------
    InputError
        If the file, or a field of it, is missing or invalid.
    """
    return checked(CaseSummary, read_json(path), path, "run the case stage again")
