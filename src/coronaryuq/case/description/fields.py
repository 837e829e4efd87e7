"""The fields of `case.yaml`: a patient's files, their units, and blood and tissue properties."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from coronaryuq.case.case_json import AnatomyKind, Artery, Point
from coronaryuq.case.description.faults import one_line
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.description.wire_place import WirePlace
from coronaryuq.case.description.yaml_file import read_yaml, validated
from coronaryuq.core.blood import viscosity_of
from coronaryuq.core.units import (
    BLOOD_DENSITY,
    BLOOD_VISCOSITY,
    FLOWS,
    LENGTHS,
    TISSUE_DENSITY,
    perfusions,
    standard_unit,
)

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


def _unit(*known: str) -> Any:
    """Return the type of a unit that may be spelt in any usual way."""

    def spelt(written: Any) -> Any:
        return standard_unit(written, known) or written if isinstance(written, str) else written

    return Annotated[Literal[known], BeforeValidator(spelt)]


if TYPE_CHECKING:
    # mypy knows no Literal whose values are computed.
    LengthUnit = str
    PerfusionUnit = str
    FlowUnit = str
    TerritoryUnit = str
else:
    LengthUnit = _unit(*LENGTHS)
    PerfusionUnit = _unit(*perfusions())
    FlowUnit = _unit(*FLOWS)
    TerritoryUnit = _unit(*FLOWS, "fraction", *perfusions(), "volume")


KINDS: tuple[AnatomyKind, ...] = get_args(AnatomyKind)
ARTERIES: tuple[Artery, ...] = get_args(Artery)


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, str_strip_whitespace=True)


class Anatomy(_Model):
    """The vessels: exactly one of centrelines, surface, simvascular and mesh."""

    centrelines: str | None = Field(
        None,
        description="Centrelines: VTP with point data Radius (or VMTK's MaximumInscribedSphereRadius) and, if there, "
        "cell data VesselName and Branch; or a CSV of points: name, x, y, z, radius and, if there, parent and branch.",
    )
    surface: str | None = Field(None, description="Closed surface of the lumen, including caps (STL, VTP, PLY).")
    simvascular: str | None = Field(
        None, description="SimVascular project folder with Paths/*.pth and Segmentations/*.ctgr."
    )
    groups: list[str] = Field(
        default_factory=list,
        description="Contour groups of the SimVascular project to use, for paths that have several.",
    )
    mesh: str | None = Field(None, description="SimVascular mesh-complete folder.")
    unit: LengthUnit = Field("cm", description="Length unit of these files, and of points in this description.")
    inlet: Point | None = Field(
        None,
        description="A point near the aortic inlet (at the valve); needed only if the two aortic ends are confused.",
    )

    @model_validator(mode="after")
    def _one_kind(self):
        given = [kind for kind in KINDS if getattr(self, kind)]
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(KINDS)}; given: {', '.join(given) or 'none'}")
        return self

    @property
    def kind(self) -> AnatomyKind:
        return next(kind for kind in KINDS if getattr(self, kind))

    @property
    def path(self) -> str:
        """The file or folder of the anatomy."""
        return str(getattr(self, self.kind))


class Label(_Model):
    """Labels of the cells, points or voxels in the left ventricular wall."""

    file: str | None = Field(None, description="Label image on the map's grid, if the labels are in a separate file.")
    array: str | None = Field(None, description="Label array in a VTK file.")
    values: list[int] = Field(min_length=1, description="Label values of the left ventricular wall.")


class Registration(_Model):
    """An affine map from the perfusion image to the anatomy, computed from two images."""

    fixed: str = Field(description="Image in the anatomy's space (CT angiography).")
    moving: str | None = Field(
        None,
        description="Image in the map's space to register to it, such as the scan from which the map was made; "
        "default: the map itself, which is much less certain.",
    )


class Perfusion(_Model):
    """The map of myocardial blood flow under hyperaemia."""

    file: str = Field(description="VTU, VTP, VTK, VTI, NIfTI or NRRD.")
    array: str | None = Field(
        None, description="Point or cell array with the flow; may be left out if the file has only one."
    )
    unit: PerfusionUnit = Field(description="Unit of the values.")
    length_unit: LengthUnit = Field(description="Length unit of the map's points (mm for NIfTI and NRRD).")
    label: Label | None = Field(None, description="Select the left ventricular wall by label.")
    threshold: float | None = Field(
        None,
        gt=0,
        description="Select the left ventricular wall as the largest connected part above this value, in `unit`.",
    )
    affine: list[list[float]] | None = Field(
        None,
        description="4 x 4 matrix from the map's space (in its length unit; LPS for NIfTI and NRRD) to the anatomy's "
        "space in cm.",
    )
    transform: str | None = Field(
        None,
        description="Linear transform instead, in a file of ITK (.tfm, .h5, .txt, .mat), as 3D Slicer saves it after "
        "the map was moved onto the anatomy: from LPS positions in the anatomy to those in the map, mm.",
    )
    registration: Registration | None = Field(None, description="Compute the affine matrix from two images instead.")

    @property
    def placed_by(self) -> Literal["affine", "transform", "registration"] | None:
        """The field that places the map relative to the anatomy."""
        ways: tuple[Literal["affine", "transform", "registration"], ...] = ("affine", "transform", "registration")
        return next((way for way in ways if getattr(self, way) is not None), None)

    @model_validator(mode="after")
    def _consistent(self):
        if self.label is not None and self.threshold is not None:
            raise ValueError("give label or threshold, not both")
        if sum(way is not None for way in (self.affine, self.transform, self.registration)) > 1:
            raise ValueError("give only one of affine, transform and registration")
        if self.affine is not None and [len(row) for row in self.affine] != [4, 4, 4, 4]:
            raise ValueError("affine must have 4 rows of 4 numbers")
        return self


class TerritoryFlows(_Model):
    """Measured hyperaemic flow of each LV-perfusing outlet, for use without a perfusion map."""

    file: str = Field(
        description="CSV with one row per LV-perfusing outlet: its name (or that of its boundary condition) and "
        "either flow (with volume, cm3, if known), or mbf and volume, or only volume."
    )
    unit: TerritoryUnit = Field(
        description="Unit of the table's flow; or of its mbf, the territory's mean perfusion; or `fraction` of "
        "`total`; or `volume`, which divides `total` in proportion to territory volumes."
    )
    total: float | None = Field(None, gt=0, description="Total LV flow, divided in proportion to fractions or volumes.")
    total_unit: FlowUnit = Field("mL/s", description="Unit of `total`.")

    @model_validator(mode="after")
    def _total_where_shared(self):
        if (self.unit in ("fraction", "volume")) != (self.total is not None):
            raise ValueError("give total with unit fraction or volume, and only then")
        return self


class StenosisPlace(_Model):
    """A stenosis, located by its extent along a vessel, by a nearby point, or by a block of the given network."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9]{0,15}$")] = Field(
        description="Name in tables and in the report: the artery (LM, LAD, LCx, RCA), or any other, such as LAD2."
    )
    artery: Artery | None = Field(
        None, description="Artery of the stenosis; default: its name, or else the artery that its vessel belongs to."
    )
    vessel: str | None = Field(None, description="Vessel of the tree; needs `start` and `end`.")
    start: float | None = Field(None, ge=0, description="Start of the stenosis, cm along the vessel.")
    end: float | None = Field(None, gt=0, description="End of the stenosis, cm along the vessel.")
    point: Point | None = Field(None, description="A point near the throat, in the anatomy's length unit.")
    length: float | None = Field(
        None, gt=0, le=10, description="Length of the stenosis at `point`, cm; default: measured on the vessel."
    )
    block: str | None = Field(None, description="0D vessel of a given network that carries the stenosis coefficient.")

    @field_validator("name")
    @classmethod
    def _spelt_as_usual(cls, name: str) -> str:
        return next((artery for artery in ARTERIES if artery.lower() == name.lower()), name)

    @property
    def stated_artery(self) -> Artery | None:
        """The artery that the description gives, by itself or as the name."""
        return self.artery or next((artery for artery in ARTERIES if artery == self.name), None)

    @model_validator(mode="after")
    def _one_way(self):
        ways = [self.vessel is not None, self.point is not None, self.block is not None]
        if sum(ways) != 1:
            raise ValueError("give vessel with start and end, or point, or block")
        if (self.vessel is not None) != (self.start is not None) or (self.start is None) != (self.end is None):
            raise ValueError("give start and end (cm along the vessel) with vessel")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise ValueError("end must be greater than start")
        if self.length is not None and self.point is None:
            raise ValueError("give length only with point")
        return self


class Measurements(_Model):
    """Measurements of the patient's circulation, in which the campaign searches for effects that the model misses."""

    file: str = Field(
        description="CSV of condition, quantity, location, statistic, time, value, sd, unit; see the guide on missing "
        "effects."
    )
    conditions: str = Field(
        description="YAML of the conditions under which they were taken, and what each changes in the network."
    )
    map_condition: str | None = Field(
        None,
        description="Condition under which the table's perfusion is read from the case's own map; a named error of the "
        "map then corrects the target flows, too.",
    )


class SystemicOutlet(_Model):
    """An outlet of the aorta, which ends in a Windkessel."""

    name: Name = Field(description="Boundary condition, for example BC_RCR1.")
    vessel: str | None = Field(None, description="Vessel of the tree, or block of the network, that ends there.")
    point: Point | None = Field(None, description="A point near the cap, in the anatomy's length unit.")


class Description(_Model):
    """One patient. Paths are relative to the folder of `case.yaml`."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,63}$")] = Field(description="Name of the case.")
    description: str = Field("", max_length=2000, description="Free text for readers.")
    anatomy: Anatomy | None = Field(None, description="The vessels; may be left out if a network is given.")
    network: str | None = Field(
        None, description="0D network (svZeroDSolver JSON) to use instead of one built from the anatomy."
    )
    network_units: Literal["auto", "cgs", "mmHg"] = Field(
        "auto",
        description="Pressure unit of that network: dyn/cm2 (cgs) or mmHg; auto infers it from the systemic "
        "resistance.",
    )
    perfusion: Perfusion | None = Field(None, description="Map of myocardial blood flow.")
    territory_flows: TerritoryFlows | None = Field(None, description="Measured flow of each outlet, instead of a map.")
    outlets: str = Field(
        description="CSV of coronary outlets: name; vessel or x, y, z; perfuses (LV, RV or septum); branch (LAD, LCx "
        "or RCA); optional bc (default BC_name) and label."
    )
    systemic_outlets: list[SystemicOutlet] = Field(
        default_factory=list, description="Outlets of the aorta; default: all aortic ends, named BC_RCR1, BC_RCR2, ..."
    )
    stenoses: Literal["auto"] | list[StenosisPlace] = Field(
        description="Stenoses, any number in an artery; or `auto`: the narrowest place of each artery if it has lost "
        "as much of its area as `patient.narrowing` says, and every other that has lost as much as `patient.serial`."
    )
    ffr_beyond_mm: float | None = Field(
        15.0,
        ge=0,
        le=50,
        description="Distance beyond the end of a stenosis at which its FFR is read, mm; experts advise 10 to 20. "
        "Where the vessel ends or branches, or the next stenosis begins, earlier: the last place before. null: 0D "
        "reads at the end of the stenosis, and 3D at `mesh.ffr_diameters` beyond it.",
    )
    ffr_at: list[WirePlace] = Field(
        default_factory=list,
        description="Places of a pressure wire at which FFR is predicted, with the measured value if there is one.",
    )
    targets: str | None = Field(
        None, description="Clinical targets: CSV of name, description and value (or none), or the same in YAML."
    )
    measurements: Measurements | None = Field(
        None, description="Measurements in which to search for effects that the model misses."
    )
    period: float | None = Field(
        None,
        gt=0.2,
        lt=3,
        description="Cardiac period, s; default: that of the target HR, else of the network, else 1.0.",
    )
    density: float = Field(BLOOD_DENSITY, ge=0.9, le=1.2, description="Blood density, g/cm3.")
    viscosity: float | None = Field(
        None,
        ge=0.005,
        le=0.2,
        description=f"Blood viscosity, poise; default: that of `haematocrit`, or {BLOOD_VISCOSITY:g}.",
    )
    lumen: LumenError | None = Field(
        None,
        description="Error of the lumen's segmentation, for `uncertainty: full`; default: that of 0.35 mm voxels.",
    )
    errors: RoutineErrors | None = Field(
        None,
        description="Errors of cuff, echocardiogram and assumed values, for `uncertainty: full`; default: as listed.",
    )
    haematocrit: float | None = Field(
        None,
        gt=0.1,
        lt=0.7,
        description="Volume fraction of red cells, which gives the viscosity (Pries et al. 1992) unless stated.",
    )
    tissue_density: float = Field(TISSUE_DENSITY, ge=0.9, le=1.2, description="Density of myocardium, g/mL.")
    hyperaemia: float = Field(
        0.24,
        gt=0,
        le=1,
        description="Coronary resistance in the state in which the map was acquired, relative to rest.",
    )

    @property
    def blood_viscosity(self) -> float:
        """Viscosity, P: as given, else that of the haematocrit, else the default."""
        return viscosity_of(self.haematocrit) if self.viscosity is None else self.viscosity

    @property
    def length_unit(self) -> str:
        """Length unit of the anatomy and of all points; cm without an anatomy."""
        return "cm" if self.anatomy is None else self.anatomy.unit

    @model_validator(mode="after")
    def _enough(self):
        if self.anatomy is None and self.network is None:
            raise ValueError("give anatomy, or network, or both")
        if (self.perfusion is None) == (self.territory_flows is None):
            raise ValueError("give perfusion (a map) or territory_flows (a table), exactly one")
        if self.anatomy is None and self.ffr_at:
            raise ValueError("ffr_at needs an anatomy: a network alone has no places along an artery")
        if isinstance(self.stenoses, list):
            names = [s.name.lower() for s in self.stenoses]
            for s in self.stenoses:
                if names.count(s.name.lower()) > 1:
                    raise ValueError(f"stenoses has {s.name} twice; give each its own name, such as {s.name}2")
            blocks = [s.block for s in self.stenoses if s.block is not None]
            for block in blocks:
                if blocks.count(block) > 1:
                    shared = " and ".join(s.name for s in self.stenoses if s.block == block)
                    raise ValueError(f"stenoses of {shared} share the 0D vessel {block}; give each its own block")
            if self.anatomy is None and any(s.block is None for s in self.stenoses):
                raise ValueError("without an anatomy, give every stenosis by its block of the network")
            if self.network is None and any(s.block is not None for s in self.stenoses):
                raise ValueError("a stenosis given by its block needs a network")
        elif self.anatomy is None:
            raise ValueError("stenoses: auto needs an anatomy")
        return self


def read_description(path: str | Path) -> Description:
    """Read `case.yaml`.

    Raises
    ------
    InputError
        If a field is missing, unknown or invalid.
    """
    content = read_yaml(path)
    try:
        return validated(Description, content)
    except ValidationError as errors:
        raise one_line(path, errors, Description) from None


def schema() -> dict[str, Any]:
    """Return the JSON schema of `case.yaml`, for editors."""
    return Description.model_json_schema()
