"""Write a draft as files: `case.yaml`, its tables, a configuration, and a page on what to do next."""

import csv
import io
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from coronaryuq.case.anatomy.dominance import WORDS
from coronaryuq.case.draft.draft import CASE, FLOWS, OUTLETS, TARGETS, Draft, DraftRow
from coronaryuq.case.tables.targets import OUTPUT_AND_RATE
from coronaryuq.case.tables.targets import TARGETS as KNOWN_TARGETS
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import check_folder
from coronaryuq.core.units import percent

CONFIGURATION, README = "campaign.yaml", "README.md"
LITERATURE = {
    "Qsystole_perc": 0.9,
    "PpulMean": 14.0,
    "LCorMaxRatio": 2.4,
    "LCorTotRatio": 4.667,
    "LThirdFF": 0.46,
    "LHalfFF": 0.67,
    "LGradOK": 5.0,
    "RCorMaxRatio": 1.4,
    "RCorTotRatio": 1.2857,
    "RThirdFF": 0.39,
    "RHalfFF": 0.57,
    "RGradOK": 5.0,
}
"""Population averages of the public svZeroDEstimator example, whose tolerances `TARGETS` has, in its units."""


@dataclass(frozen=True)
class Inputs:
    """Further files that the user has: a perfusion map with its entry in `case.yaml`, a table of targets."""

    perfusion: Mapping[str, Any] | None = None
    targets: Path | None = None

    @property
    def to_write(self) -> list[str]:
        """Names of the files of a draft, `case.yaml` last."""
        given = {FLOWS: self.perfusion, TARGETS: self.targets}
        return [file for file in (TARGETS, FLOWS, OUTLETS, CONFIGURATION, README, CASE) if given.get(file) is None]


def write_draft(folder: Path, name: str, draft: Draft, inputs: Inputs, settings: Mapping[str, Any]) -> list[str]:
    """Write a draft's files into a folder and return their names.

    Parameters
    ----------
    folder
        Existing or new; on any failure nothing is left in it.
    name
        Name of the case and of the campaign.
    draft
        The draft.
    inputs
        Further files.
    settings
        Settings of the campaign, without name and case.

    Raises
    ------
    InputError
        If one of the files is there already.
    """
    check_free(folder, inputs)
    contents: dict[str, Callable[[], str]] = {
        TARGETS: targets_table,
        FLOWS: lambda: flows_table(draft.rows),
        OUTLETS: lambda: outlets_table(draft.rows),
        CONFIGURATION: lambda: configuration(name, settings),
        README: lambda: readme(name, draft, inputs),
        CASE: lambda: case_text(folder, name, draft, inputs),
    }
    texts = {file: contents[file]() for file in inputs.to_write}
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    try:
        part.chmod(0o755)
        for file, text in texts.items():
            (part / file).write_text(text, encoding="utf-8", newline="\n")
        if folder.is_dir():
            for file in texts:  # case.yaml is the last
                (part / file).rename(folder / file)
        else:
            part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return list(texts)


def check_free(folder: Path, inputs: Inputs) -> None:
    """Raise InputError if a file of a draft is there already, or the folder cannot be written."""
    check_folder(folder)
    for file in inputs.to_write:
        if (folder / file).exists() or (folder / file).is_symlink():
            remedy = "is there already and is not overwritten; name another folder with --into"
            raise InputError(folder / file, None, None, remedy)


def outlets_table(rows: Sequence[DraftRow]) -> str:
    """Return `outlets.csv`; blanks are for the user."""
    columns = ["name"]
    columns += ["vessel"] if any(row.vessel is not None and row.vessel != row.name for row in rows) else []
    columns += ["bc"] if any(row.bc is not None for row in rows) else []
    columns += ["x", "y", "z"] if any(row.point is not None for row in rows) else []
    columns += ["perfuses", "branch"]
    columns += ["label"] if any(row.label != row.name for row in rows) else []
    cells = [
        {
            "name": row.name,
            "vessel": row.vessel,
            "bc": row.bc or f"BC_{row.name}",
            **dict(zip("xyz", row.point or (None,) * 3, strict=True)),
            "perfuses": row.perfuses,
            "branch": row.branch,
            "label": row.label,
        }
        for row in rows
    ]
    return _table(columns, cells)


def flows_table(rows: Sequence[DraftRow]) -> str:
    """Return `flows.csv`: a blank flow for every outlet that perfuses, or may perfuse, the left ventricle."""
    return _table(["name", "flow"], [{"name": row.name} for row in rows if row.perfuses in ("LV", None)])


def targets_table() -> str:
    """Return `targets.csv`: blanks for what is measured on a patient, population averages for the rest."""
    shown = [t for t in (*OUTPUT_AND_RATE, *KNOWN_TARGETS) if not t.name.endswith("_conv")]
    cells = []
    for target in sorted(shown, key=lambda target: not target.clinical):
        origin = "measured on the patient" if target.clinical else "optional"
        value = LITERATURE.get(target.name)
        origin = "literature: svZeroDEstimator" if value is not None else origin
        cells.append(
            {
                "name": target.name,
                "value": "none" if value is None else f"{value:g}",
                "unit": target.unit,
                "description": f"{target.description} ({origin})",
            }
        )
    return _table(["name", "value", "unit", "description"], cells)


def _table(columns: Sequence[str], cells: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: "" if value is None else value for key, value in row.items()} for row in cells)
    return text.getvalue()


def configuration(name: str, settings: Mapping[str, Any]) -> str:
    """Return the campaign's configuration."""
    values = {"name": re.sub(r"[^A-Za-z0-9_-]", "_", name), "case": CASE} | dict(settings)
    lines = [f"{key}: {_flow(value)}\n" for key, value in values.items()]
    return "# Run in this folder: coronaryuq run campaign.yaml. Settings as in the configuration laptop.\n" + "".join(
        lines
    )


def case_text(folder: Path, name: str, draft: Draft, inputs: Inputs) -> str:
    """Return `case.yaml`, with comments on what was found and what was guessed."""
    source = draft.source

    def there(path: Path) -> str:
        return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()

    lines = [f"name: {_flow(name)}"]
    if source.kind == "network":
        lines.append(f"network: {_flow(there(source.path))}")
    else:
        anatomy: dict[str, Any] = {source.kind: there(source.path), "unit": draft.unit}
        anatomy |= {"groups": list(source.groups)} if source.groups else {}
        anatomy |= {"inlet": list(draft.inlet)} if draft.inlet is not None else {}
        lines.append(f"anatomy: {_flow(anatomy)}")
    lines.append(f"outlets: {OUTLETS}")
    if draft.systemic:
        lines += ["systemic_outlets:", *(f"  - {_flow(entry)}" for entry in draft.systemic)]
    if draft.stenoses:
        lines.append("stenoses:")
        lines += [f"  - {_flow(s.entry)}  # {percent(s.narrowing)} of the area" for s in draft.stenoses]
    else:
        lines.append("stenoses: []")
    if draft.wire_place is not None:
        lines += [
            "# FFR where a pressure wire was read, by distance from the ostium in cm or by a point. With your values:",
            f"# ffr_at: [{_flow(draft.wire_place)}]",
        ]
    if inputs.perfusion is not None:
        map_ = dict(inputs.perfusion)
        lines.append(f"perfusion: {_flow(map_ | {'file': there(Path(map_['file']))})}")
    else:
        lines += [
            "# Hyperaemic flow of each outlet to the left ventricle. With a perfusion map, write instead",
            "# perfusion: {file: map.nii.gz, unit: mL/min/100mL, length_unit: mm}",
            f"territory_flows: {{file: {FLOWS}, unit: mL/min}}",
        ]
    lines.append(f"targets: {TARGETS if inputs.targets is None else _flow(there(inputs.targets))}")
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """Return a value in YAML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(entry) for entry in value) + "]"
    if isinstance(value, str):
        plain = re.fullmatch(r"[A-Za-z./_][\w./+-]*", value) and isinstance(yaml.safe_load(value), str)
        return value if plain else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)


def readme(name: str, draft: Draft, inputs: Inputs) -> str:
    """Return a page on what is left to do, what was guessed, and the next commands."""
    todo = [f"- `{OUTLETS}`: {text}." for text in _left_open(draft.rows)]
    if inputs.perfusion is None:
        todo.append(
            f"- `{FLOWS}`: the hyperaemic flow of every outlet that perfuses the left ventricle (LV), in mL/min; "
            f"delete other rows. Or give a perfusion map (`perfusion` in `{CASE}`)."
        )
    if inputs.targets is None:
        todo.append(
            f"- `{TARGETS}`: what was measured on the patient, such as pressures and stroke volume; `none` for the "
            "rest. Values marked as literature are averages: replace them where you know better."
        )
    guessed = [row for row in draft.rows if not row.named]
    checks = [f"- {note}" for note in draft.notes]
    if guessed:
        checks.append(
            "- Arteries and labels from the course of the vessels, not from names: "
            + ", ".join(f"{row.name} ({row.branch or '?'}, {row.perfuses or '?'})" for row in guessed)
        )
    if draft.stenoses:
        checks.append(
            f"- Narrowings that were found, in `{CASE}`; delete those that are no stenosis:\n"
            + "\n".join(f"    - {stenosis}" for stenosis in draft.stenoses)
        )
    elif draft.tree is not None:
        checks.append(
            f"- `stenoses` in `{CASE}`: no narrowing was found. For a 3D model name a stretch of an artery; "
            f"`coronaryuq check {CASE}` proposes one."
        )
    if draft.dominance is not None:
        checks.append(f"- Dominance by the course of the arteries: {WORDS[draft.dominance]}")
    run, why = f"coronaryuq run {CONFIGURATION}", ""
    if not draft.stenoses or draft.tree is None:
        run, why = f"{run} posterior", "   # without an anatomy or a stenosis there is no 3D model"
    parts = [f"# {name}", ""]
    if todo:
        parts += ["## To fill in", "", *todo, ""]
    if checks:
        parts += ["## To check", "", *checks, ""]
    parts += [
        "## Next commands, in this folder",
        "",
        f"    coronaryuq check {CASE}",
        f"    {run} --dry-run",
        f"    {run}{why}",
        "",
    ]
    return "\n".join(parts)


def _left_open(rows: Sequence[DraftRow]) -> list[str]:
    blank = {
        "branch (LAD, LCx or RCA)": [row.name for row in rows if row.branch is None],
        "perfuses (LV, RV or septum)": [row.name for row in rows if row.perfuses is None],
    }
    return [f"{column} of {', '.join(names)}" for column, names in blank.items() if names]
