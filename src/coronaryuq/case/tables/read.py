"""Read the tables of `case.yaml`: outlets, measured territory flows, clinical targets."""

import csv
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np

from coronaryuq.case.case_json import Branch, Point, TargetValue, Tissue
from coronaryuq.case.description.fields import TerritoryFlows
from coronaryuq.case.description.yaml_file import read_yaml
from coronaryuq.case.perfusion.perfusion_map import PLAUSIBLE_FLOW, PLAUSIBLE_VOLUME
from coronaryuq.case.tables.targets import BY_NAME, check_targets
from coronaryuq.core.errors import InputError, meant, nearest
from coronaryuq.core.io.tables import has_decimal_commas, line_number, read_csv, read_table_text
from coronaryuq.core.units import FLOWS, MBF_PER_MIN_PER_G, TISSUE_DENSITY, perfusions

Choice = TypeVar("Choice", bound=str)

BRANCHES: tuple[Branch, ...] = get_args(Branch)
TISSUES: tuple[Tissue, ...] = get_args(Tissue)
OTHER_WORDS: dict[str, Any] = {
    "leftventricle": "LV",
    "rightventricle": "RV",
    "septal": "septum",
    "cx": "LCx",
    "circumflex": "LCx",
    "leftcircumflex": "LCx",
    "leftanteriordescending": "LAD",
    "rightcoronaryartery": "RCA",
}
EMPTY = ("none", "nan", "")
"""Contents of a cell, in lower case, that mean that nothing was measured."""
MOST_OUTLETS = 500
LARGEST_TABLE = 10_000_000
"""Maximum size of a table, bytes."""


@dataclass(frozen=True)
class OutletRow:
    """One row of the outlets table; `point` is in the anatomy's length unit."""

    name: str
    bc: str
    vessel: str | None
    point: tuple[float, float, float] | None
    perfuses: Tissue
    branch: Branch
    label: str


def read_outlets(path: Path) -> list[OutletRow]:
    """Read the outlets table; raise InputError, with row and column, for a wrong cell."""
    _check_size(path)
    frame = read_csv(path, ("name", "perfuses", "branch"), words=("perfuses", "branch"))
    if not 1 <= len(frame) <= MOST_OUTLETS:
        raise InputError(path, "rows", len(frame), f"expected 1 to {MOST_OUTLETS} outlets")
    known = {"name", "bc", "vessel", "x", "y", "z", "perfuses", "branch", "label"}
    for column in frame.columns:
        if column not in known:
            near = nearest(column, known)
            raise InputError(
                path, str(column), None, f"unknown column; {near}known columns: {', '.join(sorted(known))}"
            )
    _check_filled(path, frame)
    rows = []
    for number, record in enumerate(frame.astype(object).where(frame.notna(), None).to_dict("records"), start=1):
        rows.append(_outlet(path, number, record))
    for field in ("name", "bc"):
        values = [getattr(row, field) for row in rows]
        for value in values:
            if values.count(value) > 1:
                raise InputError(path, field, value, "duplicate; every outlet needs its own")
    if not any(row.perfuses == "LV" for row in rows):
        raise InputError(path, "perfuses", None, "no outlet perfuses the LV; at least one must")
    return rows


def _check_filled(path: Path, frame) -> None:
    """Raise InputError, one for all blanks, if an outlet lacks its tissue or artery."""
    blank = {
        column: [str(name) for name, cell in zip(frame["name"], frame[column], strict=True) if not str(cell).strip()]
        for column in ("perfuses", "branch")
    }
    allowed = {"perfuses": TISSUES, "branch": BRANCHES}
    asked = [
        f"{column} of {', '.join(names)} ({' or '.join(allowed[column])})" for column, names in blank.items() if names
    ]
    if asked:
        raise InputError(path, next(c for c in blank if blank[c]), None, f"not given; fill in {'; '.join(asked)}")


def _outlet(path: Path, number: int, record: dict[str, Any]) -> OutletRow:
    cells = {column: str(value).strip() for column, value in record.items() if value is not None and str(value).strip()}

    def choice(column: str, allowed: tuple[Choice, ...]) -> Choice:
        value = meant(cells.get(column, ""), allowed, OTHER_WORDS)
        if value in allowed:
            return value
        raise InputError(path, f"row {number}, {column}", cells.get(column), f"allowed: {', '.join(allowed)}")

    name = cells.get("name")
    if name is None or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", name):
        remedy = "expected a letter or digit, then letters, digits, _ . or -"
        raise InputError(path, f"row {number}, name", name, remedy)
    perfuses, branch = choice("perfuses", TISSUES), choice("branch", BRANCHES)
    return OutletRow(
        name,
        cells.get("bc", f"BC_{name}"),
        cells.get("vessel"),
        _point(path, number, record),
        perfuses,
        branch,
        cells.get("label", name),
    )


def _point(path: Path, number: int, record: dict[str, Any]) -> Point | None:
    values = [record.get(axis) for axis in "xyz"]
    if values == [None, None, None]:
        return None
    if None in values:
        raise InputError(path, f"row {number}, x y z", None, "give all three or none")
    try:
        x, y, z = (float(str(value)) for value in values)
    except ValueError:
        raise InputError(path, f"row {number}, x y z", values, "expected numbers") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(path, f"row {number}, x y z", (x, y, z), "expected finite numbers")
    return x, y, z


def read_territory_flows(
    file: Path, flows: TerritoryFlows, lv: dict[str, str], tissue_density: float
) -> dict[str, tuple[float, float]]:
    """Return flow (mL/s) and territory volume (cm3, NaN if not given) of every LV-perfusing outlet.

    lv: outlet → boundary condition, of the outlets that perfuse the LV; the table may use either name. Raises
    InputError for an outlet without a row, a row without an outlet, and an implausible flow.
    """
    path = file.parent / flows.file
    _check_size(path)
    if flows.unit == "volume":
        measured = "volume"
    else:
        measured = "flow" if flows.unit == "fraction" or flows.unit in FLOWS else "mbf"
    frame = read_csv(path, ("name", "mbf", "volume") if measured == "mbf" else ("name", measured))
    names = _outlet_names(path, frame, lv)
    blank = [name for name, cell in zip(names, frame[measured], strict=True) if str(cell).strip().lower() in EMPTY]
    if blank:
        remedy = f"not given for {', '.join(blank)}; measure it (unit {flows.unit}), or give a perfusion map"
        raise InputError(path, measured, None, remedy)
    values = _positive(path, frame, names, measured)
    volumes = _positive(path, frame, names, "volume") if "volume" in frame else np.full(len(names), np.nan)
    if flows.unit in FLOWS:
        flow = values * FLOWS[flows.unit]
    elif flows.unit == "fraction":
        if abs(values.sum() - 1) > 0.02:
            remedy = "fractions must add up to 1" + ("; give fractions, not per cent" if values.sum() > 50 else "")
            raise InputError(path, "flow", float(values.sum()), remedy)
        flow = values
    elif flows.unit == "volume":
        flow = values
    else:
        flow = values * perfusions(tissue_density)[flows.unit] * volumes * tissue_density
    if flows.total is not None:
        flow = flow / flow.sum() * flows.total * FLOWS[flows.total_unit]
    _plausible(file, flows, float(flow.sum()), float(volumes.sum()))
    return {name: (float(q), float(v)) for name, q, v in zip(names, flow, volumes, strict=True)}


def _outlet_names(path: Path, frame, lv: dict[str, str]) -> list[str]:
    """Return the outlet of every row, all of `lv` exactly once."""
    own = {bc: name for name, bc in lv.items()} | {name: name for name in lv}
    cells = [str(cell).strip() for cell in frame["name"]]
    names = [own[cell] for cell in cells if cell in own]
    missing = [name for name in lv if name not in names]
    if strangers := [cell for cell in cells if cell not in own]:
        one = "not an outlet that perfuses the LV by the outlets table; delete its row"
        several = "not outlets that perfuse the LV by the outlets table; delete their rows"
        remedy = one if len(strangers) == 1 else several
        remedy += f", or correct the name; without a row: {', '.join(missing)}" if missing else ""
        raise InputError(path, "name", ", ".join(strangers), remedy)
    for number, name in enumerate(names):
        if name in names[:number]:
            raise InputError(path, "name", cells[number], "duplicate; keep one row")
    if missing:
        raise InputError(path, "name", ", ".join(missing), "missing; every outlet that perfuses the LV needs a row")
    return names


def _positive(path: Path, frame, names: list[str], column: str) -> np.ndarray:
    values = _numbers(path, frame, column)
    if (values <= 0).any():
        worst = int(np.argmin(values))
        raise InputError(path, f"{column} of {names[worst]}", float(values[worst]), "must be positive")
    return values


def _plausible(file: str | Path, flows: TerritoryFlows, flow: float, volume: float) -> None:
    """Check the total flow (mL/s) and, if volumes are known, the wall volume and its perfusion."""
    field, value = ("unit", flows.unit) if flows.total is None else ("total", f"{flows.total:g} {flows.total_unit}")
    if not 0.1 <= flow <= 60.0:
        raise InputError(
            file, f"territory_flows.{field}", value, f"gives an LV flow of {flow:.3g} mL/s; check the unit"
        )
    if not np.isfinite(volume):
        return
    low, high = PLAUSIBLE_VOLUME
    if not low <= volume <= high:
        raise InputError(
            file, "territory_flows.file", f"{volume:.3g} cm3", "implausible wall volume; volume must be in cm3"
        )
    perfusion = flow / (volume * TISSUE_DENSITY) / MBF_PER_MIN_PER_G
    low, high = PLAUSIBLE_FLOW
    if not low <= perfusion <= high:
        raise InputError(
            file, f"territory_flows.{field}", value,
            f"gives a mean flow of {perfusion:.3g} mL/min/g, outside {low} to {high}; check its unit and volume (cm3)",
        )  # fmt: skip


def read_case_targets(path: Path) -> dict[str, TargetValue]:
    """Read clinical targets by name, checked for plausibility (`check_targets`).

    A CSV is read as by `csv_targets`; YAML is `NAME: value` or `NAME: {value, unit, description}`.
    Without a unit, pressures are dyn/cm2 if the largest in the file is 1000 or more, else mmHg.
    """
    _check_size(path)
    if path.suffix.lower() in (".yaml", ".yml"):
        entries = {name: _yaml_target(path, name, entry) for name, entry in read_yaml(path).items()}
    else:
        entries = csv_targets(path)
    pressures = [abs(value or 0.0) for name, (_, value, _) in entries.items() if _is_pressure(name)]
    pressure = "mmHg" if max(pressures, default=0.0) < 1000.0 else "dyn/cm2"
    targets = {}
    for name, (description, value, unit) in entries.items():
        target = BY_NAME.get(name)
        if target is not None:
            unit = unit or (pressure if _is_pressure(name) else target.unit)
            description = description or target.description
        targets[name] = TargetValue(description=description, value=value, unit=unit)
    check_targets(targets, path)
    return targets


def _is_pressure(name: str) -> bool:
    return name in BY_NAME and BY_NAME[name].unit == "mmHg"


def csv_targets(path: Path) -> dict[str, tuple[str | None, float | None, str | None]]:
    """Read a table of targets: name → description, value, unit; each may be None.

    With a header, the columns are name, value and, optionally, description and unit; without one, they are name,
    description, value.
    """
    targets: dict[str, tuple[str | None, float | None, str | None]] = {}
    text, separator = read_table_text(path)
    comma = has_decimal_commas(path)
    rows = list(enumerate(csv.reader(text.splitlines(), delimiter=separator), start=1))
    rows = [(number, [cell.strip() for cell in row]) for number, row in rows if any(cell.strip() for cell in row)]
    header = [cell.lower() for cell in rows[0][1]] if rows else []
    for column in header if "name" in header and "value" in header else ():
        if column and header.count(column) > 1:
            raise InputError(path, column, None, "column given twice; keep one")
    headed = "name" in header and "value" in header
    for number, row in rows[1:] if headed else rows:
        if headed and len(row) == len(header):
            cells = dict(zip(header, row, strict=True))
        elif not headed and len(row) > 3 and separator == "," and all(_is_number(cell) for cell in row[-2:]):
            remedy = "a decimal comma? write a decimal point, or quote a description that has commas"
            raise InputError(path, f"line {line_number(path, number - 2)}", separator.join(row), remedy)
        elif not headed and len(row) >= 3:
            cells = {"name": row[0], "description": ", ".join(row[1:-1]), "value": row[-1]}
        else:
            wanted = ", ".join(header) if headed else "name, description, value; or a header with name and value"
            raise InputError(path, f"line {line_number(path, number - 2)}", separator.join(row), f"expected {wanted}")
        name, value = cells["name"], cells["value"]
        value = value.replace(",", ".") if comma else value
        if name in targets:
            raise InputError(path, name, value, "duplicate; keep one row")
        targets[name] = cells.get("description") or None, _number(path, name, value), cells.get("unit") or None
    return targets


def _yaml_target(path: Path, name: str, entry: Any) -> tuple[str | None, float | None, str | None]:
    if not isinstance(entry, dict):
        return None, _number(path, name, entry), None
    for key in entry:
        if key not in ("value", "unit", "description"):
            raise InputError(path, f"{name}.{key}", None, "unknown field; known fields: value, unit, description")
    return entry.get("description"), _number(path, name, entry.get("value")), entry.get("unit")


def _number(path: Path, name: str, value: Any) -> float | None:
    if value is None or (isinstance(value, str) and value.lower() in EMPTY):
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not math.isfinite(number):
        remedy = "expected a number or none"
        if isinstance(value, str) and math.isnan(number) and re.match(r"[-+]?[\d.]+\s*[A-Za-z%]", value):
            remedy += "; put units into a column `unit`, with a header"
        elif isinstance(value, str) and re.fullmatch(r"[-+]?\d+(,\d+)+(\.\d*)?", value):
            remedy += ", without separators of thousands"
        raise InputError(path, name, value, remedy)
    return number


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[-+]?\d+(\.\d*)?", cell) is not None


def _numbers(path: Path, frame, column: str) -> np.ndarray:
    values = []
    for number, cell in enumerate(frame[column], start=1):
        value = _number(path, f"row {number}, {column}", cell if isinstance(cell, str) else float(cell))
        if value is None:
            raise InputError(path, f"row {number}, {column}", cell, "expected a number")
        values.append(value)
    return np.array(values)


def _check_size(path: Path) -> None:
    if not path.is_file():
        there = "is no regular file, or a link that leads to none" if os.path.lexists(path) else "no such file"
        raise InputError(path, None, None, "is a folder; name a file" if path.is_dir() else there)
    if path.stat().st_size > LARGEST_TABLE:
        raise InputError(
            path, None, f"{path.stat().st_size} bytes", f"more than {LARGEST_TABLE} bytes; expected a table"
        )
