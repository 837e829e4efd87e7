"""`case.json`, as every later stage reads it: checked, so that none of them meets half a case."""

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json

REMEDY = "make it again with the case stage"


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class _Aorta(_Part):
    pressure: str = ""


class _Outlet(_Part):
    name: str = ""
    bc: str = ""
    vessel: str = ""
    perfuses: Literal["LV", "RV", "septum"] = "LV"
    branch: str = ""
    point: tuple[float, float, float] | None = None
    radius: float | None = Field(None, gt=0)


class _Stenosis(_Part):
    name: Literal["LAD", "LCx", "RCA"] = "LAD"
    vessel: str = ""
    ffr: str = ""
    flow: str = ""
    root: str = ""
    outlet: str = ""


class _Case(_Part):
    name: str = ""
    period: float = Field(1.0, gt=0)
    density: float = Field(1.0, gt=0)
    viscosity: float = Field(1.0, gt=0)
    hyperaemia: float = Field(1.0, gt=0)
    tissue_density: float = Field(1.0, gt=0)
    aorta: _Aorta = _Aorta()
    outlets: list[_Outlet] = Field([_Outlet()], min_length=1)
    stenoses: list[_Stenosis] = []
    targets: dict[str, Any] = {}


def read_case(path: str | Path, *needs: str) -> dict[str, Any]:
    """Read `case.json` (docs/architecture.md); `InputError` for a field of another kind than it should be.

    needs: what the caller goes on to read, such as "density" or, of every stenosis, "stenoses.ffr"; `InputError` where
    that is missing.
    """
    case = read_json(path)
    try:
        _Case.model_validate(case)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"])) or None
        message = first["msg"][0].lower() + first["msg"][1:]
        raise InputError(path, field, first["input"], f"{message}; {REMEDY}") from None
    for need in needs:
        _find(path, case, need.split("."), "")
    return case


def _find(path: str | Path, value: Any, parts: list[str], where: str) -> None:
    if isinstance(value, list):
        for number, entry in enumerate(value):
            _find(path, entry, parts, f"{where}.{number}")
    elif parts:
        if parts[0] not in value:
            raise InputError(path, f"{where}.{parts[0]}".strip("."), None, f"missing; {REMEDY}")
        _find(path, value[parts[0]], parts[1:], f"{where}.{parts[0]}")
