"""`case.yaml`: what a patient consists of, which files hold it, and in which units."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from coronaryuq.case.case_json import Branch, Point
from coronaryuq.case.description.yaml_file import read_yaml
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY, FLOWS, LENGTHS, TISSUE_DENSITY, perfusions

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,63}$")]
LengthUnit = Literal[tuple(LENGTHS)]
PerfusionUnit = Literal[tuple(perfusions())]
FlowUnit = Literal[tuple(FLOWS)]
TerritoryUnit = Literal[(*FLOWS, "fraction", *perfusions(), "volume")]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Anatomy(_Model):
    """The vessels: exactly one of centrelines, surface, simvascular and mesh."""

    centrelines: str | None = Field(
        None, description="VTP of centrelines: a polyline per vessel, point data Radius, cell data VesselName, Branch"
    )
    surface: str | None = Field(None, description="closed surface of the lumen, caps included (STL, VTP, PLY)")
    simvascular: str | None = Field(
        None, description="SimVascular project folder with Paths/*.pth and Segmentations/*.ctgr"
    )
    mesh: str | None = Field(None, description="SimVascular mesh-complete folder")
    unit: LengthUnit = Field("cm", description="length unit of these files, and of points in this description")
    inlet: Point | None = Field(
        None, description="a point near the aortic inlet (valve side), where the two aortic ends could be confused"
    )

    @model_validator(mode="after")
    def _one_kind(self):
        given = [kind for kind in ("centrelines", "surface", "simvascular", "mesh") if getattr(self, kind)]
        if len(given) != 1:
            raise ValueError(
                f"give exactly one of centrelines, surface, simvascular, mesh; given: {', '.join(given) or 'none'}"
            )
        return self

    @property
    def kind(self) -> str:
        return next(kind for kind in ("centrelines", "surface", "simvascular", "mesh") if getattr(self, kind))


class Label(_Model):
    """Which cells, points or voxels are left ventricular wall."""

    file: str | None = Field(None, description="label volume of the same grid as the map, if it is a file of its own")
    array: str | None = Field(None, description="label array in a VTK file")
    values: list[int] = Field(min_length=1, description="label values that mean left ventricular wall")


class Registration(_Model):
    """Bring the perfusion image to the anatomy by another image: an affine map computed from the two."""

    fixed: str = Field(description="image in the anatomy's space (CT angiography)")
    moving: str | None = Field(None, description="image in the map's space to compare with it; none: the map itself")


class Perfusion(_Model):
    """The map of myocardial blood flow under hyperaemia."""

    file: str = Field(description="VTU, VTP, VTK, VTI, NIfTI or NRRD")
    array: str | None = Field(None, description="point or cell array with the flow; none: the only one, or the image")
    unit: PerfusionUnit = Field(description="unit of the values")
    length_unit: LengthUnit = Field(description="length unit of the map's points (mm for NIfTI and NRRD)")
    label: Label | None = Field(None, description="left ventricular wall by label")
    threshold: float | None = Field(
        None, gt=0, description="left ventricular wall by value: the largest connected part above it, in `unit`"
    )
    affine: list[list[float]] | None = Field(
        None,
        description="4 x 4 matrix from the map's space (in its length unit; LPS for NIfTI and NRRD) to the anatomy's, "
        "in cm",
    )
    registration: Registration | None = Field(None, description="compute that matrix from images instead")

    @model_validator(mode="after")
    def _consistent(self):
        if self.label is not None and self.threshold is not None:
            raise ValueError("give label or threshold, not both")
        if self.affine is not None and self.registration is not None:
            raise ValueError("give affine or registration, not both")
        if self.affine is not None and [len(row) for row in self.affine] != [4, 4, 4, 4]:
            raise ValueError("affine must have 4 rows of 4 numbers")
        return self


class TerritoryFlows(_Model):
    """Measured hyperaemic flow of each LV-perfusing outlet, where the map itself is not at hand."""

    file: str = Field(
        description="CSV with a row per LV-perfusing outlet: name (of the outlet or its boundary condition), and flow, "
        "with volume (cm3) if known; or mbf and volume; or volume alone"
    )
    unit: TerritoryUnit = Field(
        description="unit of flow; `fraction` of the total; unit of mbf, the territory's mean perfusion; or `volume`: "
        "the total shared in proportion to territory volumes"
    )
    total: float | None = Field(None, gt=0, description="total LV flow that fractions or volumes share")
    total_unit: FlowUnit = Field("mL/s", description="unit of total")

    @model_validator(mode="after")
    def _total_where_shared(self):
        if (self.unit in ("fraction", "volume")) != (self.total is not None):
            raise ValueError("total is given with unit fraction or volume, and only then")
        return self


class StenosisPlace(_Model):
    """A stenosis: where it lies along a vessel, or near which point, or which block of a given network it is."""

    name: Branch = Field(description="the artery whose FFR, TAWSS and OSI are asked: LAD, LCx or RCA")
    vessel: str | None = Field(None, description="vessel of the tree, with start and end")
    start: float | None = Field(None, ge=0, description="cm along the vessel")
    end: float | None = Field(None, gt=0, description="cm along the vessel")
    point: Point | None = Field(None, description="a point near the throat, in the anatomy's length unit")
    length: float | None = Field(None, gt=0, le=10, description="cm; with point, where the extent is not to be found")
    block: str | None = Field(None, description="0D vessel of a given network that carries the stenosis coefficient")

    @model_validator(mode="after")
    def _one_way(self):
        ways = [self.vessel is not None, self.point is not None, self.block is not None]
        if sum(ways) != 1:
            raise ValueError("give vessel with start and end, or point, or block")
        if (self.vessel is not None) != (self.start is not None) or (self.start is None) != (self.end is None):
            raise ValueError("start and end (cm along the vessel) go with vessel")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise ValueError("end must be more than start")
        if self.length is not None and self.point is None:
            raise ValueError("length goes with point")
        return self


class SystemicOutlet(_Model):
    """An outlet of the aorta, with a Windkessel."""

    name: Name = Field(description="boundary condition, such as BC_RCR1")
    vessel: str | None = Field(None, description="vessel of the tree or block of the network that ends there")
    point: Point | None = Field(None, description="a point near the cap, in the anatomy's length unit")


class Description(_Model):
    """One patient. Paths are relative to the folder of this file."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,63}$")] = Field(description="name of the case")
    description: str = Field("", max_length=2000, description="anything a reader should know")
    anatomy: Anatomy | None = Field(None, description="the vessels; may be left out where a network is given")
    network: str | None = Field(
        None, description="ready 0D network (svZeroDSolver JSON) to be used instead of one made from the anatomy"
    )
    network_units: Literal["auto", "cgs", "mmHg"] = Field(
        "auto", description="pressure unit of that network: dyn/cm2 (cgs) or mmHg; auto: by its systemic resistance"
    )
    perfusion: Perfusion | None = Field(None, description="map of myocardial blood flow")
    territory_flows: TerritoryFlows | None = Field(None, description="measured flow per outlet instead of a map")
    outlets: str = Field(
        description="CSV of coronary outlets: name; vessel or x, y, z; perfuses (LV, RV or septum); branch (LAD, LCx "
        "or RCA); if wanted bc (default BC_name) and label"
    )
    systemic_outlets: list[SystemicOutlet] = Field(
        default_factory=list, description="outlets of the aorta; none: every aortic end is one, BC_RCR1, BC_RCR2, ..."
    )
    stenoses: Literal["auto"] | list[StenosisPlace] = Field(
        description="at most one each for LAD, LCx and RCA, or auto: the tightest narrowing of each"
    )
    targets: str | None = Field(
        None, description="clinical targets: CSV of name, description, value (or none), or the same in YAML"
    )
    period: float | None = Field(None, gt=0.2, lt=3, description="cardiac period, s; default from the network, or 1.0")
    density: float = Field(BLOOD_DENSITY, ge=0.9, le=1.2, description="blood density, g/cm3")
    viscosity: float = Field(BLOOD_VISCOSITY, ge=0.005, le=0.2, description="blood viscosity, poise")
    haematocrit: float | None = Field(
        None, gt=0.1, lt=0.7, description="red cells' share of volume, for the record; give viscosity"
    )
    tissue_density: float = Field(TISSUE_DENSITY, ge=0.9, le=1.2, description="density of myocardium, g/mL")
    hyperaemia: float = Field(
        0.24, gt=0, le=1, description="factor on coronary resistance from rest to the state in which the map was taken"
    )

    @model_validator(mode="after")
    def _enough(self):
        if self.anatomy is None and self.network is None:
            raise ValueError("give anatomy, or network, or both")
        if (self.perfusion is None) == (self.territory_flows is None):
            raise ValueError("give perfusion (a map) or territory_flows (a table), exactly one")
        if isinstance(self.stenoses, list):
            names = [s.name for s in self.stenoses]
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f"stenoses names {name} twice; one stenosis per artery")
            blocks = [s.block for s in self.stenoses if s.block is not None]
            for block in blocks:
                if blocks.count(block) > 1:
                    arteries = " and ".join(s.name for s in self.stenoses if s.block == block)
                    raise ValueError(f"stenoses of {arteries} are one 0D vessel, {block}; name the block of each")
            if self.anatomy is None and any(s.block is None for s in self.stenoses):
                raise ValueError("without anatomy, every stenosis is given by its block of the network")
            if self.network is None and any(s.block is not None for s in self.stenoses):
                raise ValueError("a stenosis given by its block needs a network")
        elif self.anatomy is None:
            raise ValueError("stenoses: auto needs an anatomy")
        return self


def read_description(path: str | Path) -> Description:
    """Read and validate `case.yaml`; anything wrong is an `InputError` on one line."""
    given = read_yaml(path)
    try:
        return Description.model_validate(given)
    except ValidationError as errors:
        raise _one_line(path, errors) from None


def _one_line(path: str | Path, errors: ValidationError) -> InputError:
    # Of a field that may be a word or a list, every type is tried and named: only what fits the user's choice is told.
    found = errors.errors(include_url=False)
    found = [e for e in found if not ("literal['auto']" in e["loc"] and isinstance(e["input"], list))] or found
    first = found[0]
    where = [str(part) for part in first["loc"] if not str(part).startswith(("literal[", "list[", "function-"))]
    field = ".".join(where) or None
    value = None if first["type"] in ("missing", "value_error") else first["input"]
    message = first["msg"].removeprefix("Value error, ")
    if "literal['auto']" in first["loc"]:
        message = "wanted auto, or a list such as [{name: LAD, vessel: LAD, start: 2.0, end: 3.0}], or [] for none"
        found = [error for error in found if error["loc"][:1] != first["loc"][:1]]
        found.insert(0, first)
    if first["type"] == "extra_forbidden":
        message = f"unknown field; known here: {', '.join(_model_at(where[:-1]).model_fields)}"
    elif first["type"] == "missing":
        message = "required field is missing"
    others = ", ".join(dict.fromkeys(".".join(map(str, error["loc"])) or "the whole" for error in found[1:]))
    return InputError(path, field, value, message[0].lower() + message[1:] + (f" (also: {others})" if others else ""))


def _model_at(where: list[str]) -> type[BaseModel]:
    model: Any = Description
    inside = {"anatomy": Anatomy, "perfusion": Perfusion, "label": Label, "registration": Registration}
    inside |= {"territory_flows": TerritoryFlows, "stenoses": StenosisPlace, "systemic_outlets": SystemicOutlet}
    for part in where:
        model = inside.get(part, model)
    return model


def schema() -> dict[str, Any]:
    """JSON schema of `case.yaml`, for editors."""
    return Description.model_json_schema()
