"""Configuration of a campaign: the model that gives the defaults, the JSON schema and the README of `config/`."""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from coronaryuq.calibration.settings import Settings as CalibrationSettings
from coronaryuq.case.description.yaml_file import read_yaml, validated
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.settings import Uncertainty
from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.plain_faults import in_plain_words
from coronaryuq.discrepancy.settings import Settings as DiscrepancySettings
from coronaryuq.estimation.settings import Settings as EstimationSettings
from coronaryuq.flow3d.mesh.settings import Settings as MeshSettings
from coronaryuq.flow3d.settings import Settings as Flow3DSettings
from coronaryuq.losses.settings import Settings as LossesSettings
from coronaryuq.perfusion.settings import Settings as PerfusionSettings
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.synthetic.settings import Settings as SyntheticSettings
from coronaryuq.zerod.settings import Settings as ZeroDSettings

EXPECTED = "not a configuration: expected a mapping of settings; see config/README.md"


class Samples(BaseModel):
    """Sample counts and portions. Counts may grow later; existing samples stay valid."""

    model_config = ConfigDict(extra="forbid")

    n_3d: int = Field(64, ge=8, description="Number of 3D runs, the pilot sample (paper: 500).")
    n_0d: int = Field(
        2000, ge=16, description="Number of 0D runs of the propagation sample and of each resampled set (paper: 10000)."
    )
    batch_3d: int = Field(16, ge=1, description="3D samples per job; use 1 for an external solver.")
    chunk_0d: int = Field(500, ge=1, description="0D samples per job.")
    chunks_resampled: int = Field(
        8, ge=1, description="Number of jobs into which the 0D runs at resampled inputs are divided."
    )
    chunk_realisations: int = Field(500, ge=1, description="Noisy perfusion realisations per job.")


class Campaign(BaseModel):
    """One campaign: a patient, a seed, and a block of settings for each stage."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")] = Field(
        description="Name of the campaign and of its results folder, `results/NAME`."
    )
    seed: int = Field(20241117, ge=0, description="Seed of all random numbers of the campaign.")
    case: str = Field("bundled", description="`bundled` for the synthetic patient, or the path of a `case.yaml`.")
    backend: Literal["ensemble", "svsolver", "svmultiphysics", "umbridge"] = Field(
        "ensemble", description="Solver of the 3D samples."
    )
    uncertainty: Uncertainty = Field(
        "paper",
        description="What is uncertain: `full` for all that is measured, with the errors that `case.yaml` states; "
        "`paper` for perfusion and resistances alone.",
    )
    paper_data: str | None = Field(
        None,
        description="Folder of the paper's published runs; required by the targets `paper_*`, used by `coverage`.",
    )
    samples: Samples = Field(default_factory=Samples, description="Sample counts and portions.")
    synthetic: SyntheticSettings = Field(default_factory=SyntheticSettings, description="The bundled patient.")
    patient: CaseSettings = Field(default_factory=CaseSettings, description="How a case is read and completed.")
    perfusion: PerfusionSettings = Field(default_factory=PerfusionSettings, description="Territories and noise.")
    calibration: CalibrationSettings = Field(
        default_factory=CalibrationSettings, description="Tuning of the closed loop."
    )
    posterior: PosteriorSettings = Field(
        default_factory=PosteriorSettings, description="Posterior of the outlet resistances."
    )
    mesh: MeshSettings = Field(default_factory=MeshSettings, description="3D domain and mesh.")
    flow3d: Flow3DSettings = Field(default_factory=Flow3DSettings, description="3D runs.")
    losses: LossesSettings = Field(
        default_factory=LossesSettings, description="Pressure losses of the 0D vessels, learnt from 3D runs."
    )
    zerod: ZeroDSettings = Field(default_factory=ZeroDSettings, description="0D runs.")
    estimation: EstimationSettings = Field(default_factory=EstimationSettings, description="Estimators and intervals.")
    discrepancy: DiscrepancySettings = Field(
        default_factory=DiscrepancySettings, description="Search for effects that the model is missing."
    )

    @model_validator(mode="after")
    def _no_known_scaling(self) -> "Campaign":
        """With `full`, the scaling follows from the measured flow, and its distribution is not known."""
        if self.uncertainty == "full":
            self.estimation = self.estimation.model_copy(update={"known_scaling": None})
        return self


def load(path: str | Path) -> Campaign:
    """Read and validate a configuration file; see `validate`."""
    return validate(read_yaml(path, EXPECTED), path)


def validate(values: Any, path: str | Path) -> Campaign:
    """Validate a configuration that has been read.

    Parameters
    ----------
    values
        Content of the file.
    path
        The file, named in errors.

    Raises
    ------
    InputError
        Names the first wrong setting and how many more there are.
    """
    if not isinstance(values, dict):
        raise InputError(path, None, None, EXPECTED)
    try:
        return validated(Campaign, values)
    except ValidationError as errors:
        first = errors.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        value = None if first["type"] == "missing" else first["input"]
        more = f" (and {errors.error_count() - 1} more)" if errors.error_count() > 1 else ""
        raise InputError(path, field, value, _remedy(first, field) + more) from None


def _remedy(fault: Mapping[str, Any], field: str) -> str:
    if fault["type"] == "extra_forbidden":
        model: Any = Campaign
        for part in field.split(".")[:-1]:
            model = model.model_fields[part].annotation
        near = nearest(field.rpartition(".")[2], model.model_fields)
        return f"unknown setting; {near}known here: {', '.join(model.model_fields)}"
    return in_plain_words(fault)


def schema() -> dict[str, Any]:
    """Return the JSON schema of the configuration, for editors."""
    return Campaign.model_json_schema()


def readme() -> str:
    """Return the README of `config/`: one table per block of settings."""
    lines = [
        "# Configuration",
        "",
        "Generated from the configuration model by `python tools/config_docs.py`; do not edit.",
        "A configuration file needs only the settings that differ from the defaults below, which are written as they",
        "would be in the file (`null`: none). `schema.json`, in the same folder, gives editors checks and completion.",
        "",
        *_table(Campaign, ""),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _yaml(value: Any) -> str:
    """Return a default as it would be written in a configuration file, on one line."""
    plain = TypeAdapter(Any).dump_python(value, mode="json", exclude_defaults=True)
    text = yaml.safe_dump(plain, default_flow_style=True, width=math.inf, sort_keys=False, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def _with_choices(description: str, annotation: Any) -> str:
    """Append the values that a setting may have, unless its description names all of them."""
    kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    choices = [value for kind in kinds if get_origin(kind) is Literal for value in get_args(kind)]
    if all(re.search(rf"\b{re.escape(value)}\b", description) for value in choices):
        return description
    names = [f"`{value}`" for value in choices] + ["`null`"] * (type(None) in kinds)
    return f"{description.rstrip('.')}; one of {', '.join(names)}."


def _table(model: type[BaseModel], prefix: str) -> list[str]:
    rows = ["| setting | default | description |", "|---|---|---|"]
    blocks = []
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            blocks.append((name, kind, field.description))
            continue
        default = "required" if field.is_required() else f"`{_yaml(field.get_default(call_default_factory=True))}`"
        text = _with_choices(field.description or "", kind).replace("|", "\\|")
        rows.append(f"| `{prefix}{name}` | {default.replace('|', '¦')} | {text} |")
    lines = [*rows, ""] if len(rows) > 2 else []
    for name, kind, description in blocks:
        lines += [f"## `{prefix}{name}`", "", description or "", "", *_table(kind, f"{prefix}{name}.")]
    return lines
