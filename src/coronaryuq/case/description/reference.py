"""The fields of `case.yaml` as tables for the documentation."""

from typing import Literal, get_args, get_origin

from pydantic import BaseModel

from coronaryuq.case.description.fields import (
    Anatomy,
    Description,
    Label,
    Measurements,
    Perfusion,
    Registration,
    StenosisPlace,
    SystemicOutlet,
    TerritoryFlows,
)
from coronaryuq.case.description.lumen import CalcifiedStretch, LumenError
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.description.wire_place import WirePlace

BLOCKS: dict[str, type[BaseModel]] = {
    "case.yaml": Description,
    "anatomy": Anatomy,
    "perfusion": Perfusion,
    "perfusion.label": Label,
    "perfusion.registration": Registration,
    "territory_flows": TerritoryFlows,
    "stenoses": StenosisPlace,
    "ffr_at": WirePlace,
    "systemic_outlets": SystemicOutlet,
    "measurements": Measurements,
    "lumen": LumenError,
    "lumen.calcified": CalcifiedStretch,
    "errors": RoutineErrors,
}
LISTS = ("stenoses", "ffr_at", "systemic_outlets", "lumen.calcified")
"""Blocks of which there may be several."""


def reference() -> str:
    """Write Markdown tables of fields, defaults and meanings, one per block, from the models that check them."""
    parts = []
    for name, model in BLOCKS.items():
        each = " (each)" if name in LISTS else ""
        parts += [f"### `{name}`{each}", "", "| field | default | description |", "|---|---|---|", *_rows(model), ""]
    return "\n".join(parts)


def _rows(model: type[BaseModel]) -> list[str]:
    rows = []
    for name, field in model.model_fields.items():
        default = "required" if field.is_required() else field.get_default(call_default_factory=True)
        shown = "required" if default == "required" else "none" if default in (None, "", []) else f"`{default}`"
        what = field.description or f"See `{name}` below."
        if get_origin(field.annotation) is Literal:
            what = f"{what.rstrip('.')}; one of {', '.join(f'`{choice}`' for choice in get_args(field.annotation))}."
        rows.append(f"| `{name}` | {shown} | {what.replace('|', '¦')} |")
    return rows
