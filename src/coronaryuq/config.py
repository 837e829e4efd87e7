"""A campaign's configuration: one model, from which the defaults, the JSON schema and the README of `config/` come."""

import math
import re
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from coronaryuq.calibration.settings import Settings as CalibrationSettings
from coronaryuq.case.description.yaml_file import read_yaml
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.settings import Settings as DiscrepancySettings
from coronaryuq.estimation.settings import Settings as EstimationSettings
from coronaryuq.flow3d.mesh.settings import Settings as MeshSettings
from coronaryuq.flow3d.settings import Settings as Flow3DSettings
from coronaryuq.perfusion.settings import Settings as PerfusionSettings
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.synthetic.settings import Settings as SyntheticSettings
from coronaryuq.zerod.settings import Settings as ZeroDSettings

WANTED = "not a configuration: wanted a mapping of settings; see config/README.md"


class Samples(BaseModel):
    """How many, and in what portions. Counts may grow later: what has been computed stays valid."""

    model_config = ConfigDict(extra="forbid")

    n_3d: int = Field(64, ge=8, description="3D runs, the pilot sample (paper: 500)")
    n_0d: int = Field(
        2000, ge=16, description="0D runs of the propagation sample and of each resampled set (paper: 10000)"
    )
    batch_3d: int = Field(16, ge=1, description="3D samples per job; 1 for an external solver")
    chunk_0d: int = Field(500, ge=1, description="0D samples per job")
    chunks_resampled: int = Field(8, ge=1, description="jobs that share the 0D runs at resampled inputs")
    chunk_realisations: int = Field(500, ge=1, description="noisy perfusion realisations per job")


class Campaign(BaseModel):
    """One campaign: a patient, a seed, and a block of settings per stage."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")] = Field(
        description="names the results folder, `results/NAME`"
    )
    seed: int = Field(20241117, ge=0, description="every random number of the campaign derives from it")
    case: str = Field("bundled", description="`bundled` for the synthetic patient, or the path of a `case.yaml`")
    backend: Literal["ensemble", "svsolver", "svmultiphysics"] = Field(
        "ensemble", description="which code runs the 3D samples"
    )
    paper_data: str | None = Field(
        None,
        description="folder with the paper's published runs, for the target `paper_table`; none: target unavailable",
    )
    samples: Samples = Field(default_factory=Samples, description="sample counts and portions")
    synthetic: SyntheticSettings = Field(default_factory=SyntheticSettings, description="the bundled patient")
    patient: CaseSettings = Field(default_factory=CaseSettings, description="reading and completing the case")
    perfusion: PerfusionSettings = Field(default_factory=PerfusionSettings, description="territories and noise")
    calibration: CalibrationSettings = Field(
        default_factory=CalibrationSettings, description="tuning of the closed loop"
    )
    posterior: PosteriorSettings = Field(
        default_factory=PosteriorSettings, description="posterior of outlet resistances"
    )
    mesh: MeshSettings = Field(default_factory=MeshSettings, description="3D domain and mesh")
    flow3d: Flow3DSettings = Field(default_factory=Flow3DSettings, description="3D runs")
    zerod: ZeroDSettings = Field(default_factory=ZeroDSettings, description="0D runs")
    estimation: EstimationSettings = Field(default_factory=EstimationSettings, description="estimators and intervals")
    discrepancy: DiscrepancySettings = Field(
        default_factory=DiscrepancySettings, description="search for what the model is missing"
    )


def load(path: str | Path) -> Campaign:
    """Read and validate a configuration file; anything wrong is an `InputError` on one line."""
    return validate(read_yaml(path, WANTED), path)


def validate(given: Any, path: str | Path) -> Campaign:
    """Validate a configuration that has been read already; `path` is named in the error."""
    if not isinstance(given, dict):
        raise InputError(path, None, None, WANTED)
    try:
        return Campaign.model_validate(given)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        value = None if first["type"] == "missing" else first["input"]
        more = f" (and {errors.error_count() - 1} more)" if errors.error_count() > 1 else ""
        raise InputError(path, field, value, _remedy(first, field) + more) from None


def _remedy(error: dict[str, Any], field: str) -> str:
    if error["type"] == "extra_forbidden":
        model: Any = Campaign
        for part in field.split(".")[:-1]:
            model = model.model_fields[part].annotation
        return f"unknown setting; known here: {', '.join(model.model_fields)}"
    return error["msg"][0].lower() + error["msg"][1:]


def schema() -> dict[str, Any]:
    """JSON schema of the configuration, for editors."""
    return Campaign.model_json_schema()


def readme() -> str:
    """The README of `config/`, one table per block."""
    lines = [
        "# Configuration",
        "",
        "Made from the configuration model by `python workflow/scripts/config_docs.py`; do not edit.",
        "A file holds only what differs from the defaults, which stand here as they would there (`null`: none).",
        "`schema.json` beside this file helps an editor.",
        "",
        *_table(Campaign, ""),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _yaml(value: Any) -> str:
    """A default as it would stand in a configuration file, on one line."""
    plain = TypeAdapter(Any).dump_python(value, mode="json", exclude_defaults=True)
    text = yaml.safe_dump(plain, default_flow_style=True, width=math.inf, sort_keys=False, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def _with_choices(what: str, kind: Any) -> str:
    """A description with the values that a setting may have, unless it speaks of them all."""
    kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    choices = [value for one in kinds if get_origin(one) is Literal for value in get_args(one)]
    if all(re.search(rf"\b{re.escape(value)}\b", what) for value in choices):
        return what
    named = [f"`{value}`" for value in choices] + ["`null`"] * (type(None) in kinds)
    return f"{what} (one of {', '.join(named)})"


def _table(model: type[BaseModel], prefix: str) -> list[str]:
    rows = ["| setting | default | what |", "|---|---|---|"]
    blocks = []
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            blocks.append((name, kind, field.description))
            continue
        default = "required" if field.is_required() else f"`{_yaml(field.get_default(call_default_factory=True))}`"
        what = _with_choices(field.description or "", kind).replace("|", "\\|")
        rows.append(f"| `{prefix}{name}` | {default.replace('|', '¦')} | {what} |")
    lines = [*rows, ""] if len(rows) > 2 else []
    for name, kind, description in blocks:
        lines += [f"## `{prefix}{name}`: {description}", "", *_table(kind, f"{prefix}{name}.")]
    return lines
