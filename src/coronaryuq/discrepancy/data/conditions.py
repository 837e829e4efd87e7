"""Conditions of the measurements: the conditions file, read and written."""

import copy
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from coronaryuq.case.description.yaml_file import read_yaml, texts
from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.io.tables import read_csv, write_csv

COVARIATES = ("LV",)
"""Measured waveforms that `drive` accepts although they are not blocks: left ventricular pressure."""
RESISTANCE, BED_SHAPE = "coronary_resistance_scale", "bed_shape"
FREE = (RESISTANCE, BED_SHAPE)
"""Parameters that may be free: the coronary resistance of a condition, and the distribution of resistance and
compliance along the beds, common to all conditions."""
LARGEST_SCALE = 20.0
"""Largest factor on a coronary resistance or a period, and the inverse of the smallest."""


@dataclass(frozen=True)
class PullbackErrors:
    """Errors of the pullbacks of a condition.

    drift_sd: standard deviation of the usual drift at the end, mmHg; 2 mmHg is a small drift (Cook et al. 2016), here
    two standard deviations. noise_length: correlation length of the noise along the path, mm. begins: fraction of the
    time from equalisation to the end that has passed when the pullback begins, for readings without a time.
    """

    drift_sd: float = 1.0
    noise_length: float = 5.0
    begins: float = 0.5


@dataclass(frozen=True)
class Condition:
    """One condition of the YAML file; see docs/how-to/discrepancy.md for the keys."""

    name: str
    coronary_resistance_scale: float = 1.0
    period_scale: float = 1.0
    scale: dict[str, dict[str, float]] = field(default_factory=dict)
    set: dict[str, dict[str, float]] = field(default_factory=dict)
    drive: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    held_out: bool = False
    free: tuple[str, ...] = ()
    stenosis: dict[str, str] = field(default_factory=dict)
    pullback: PullbackErrors = PullbackErrors()

    @property
    def anchored(self) -> bool:
        """Whether the coronary resistance is set by the condition's own mean values."""
        return RESISTANCE in self.free

    @property
    def covariates(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Measured waveforms that drive no block, over one cycle; their period may differ from the condition's."""
        return {name: self.drive[name] for name in COVARIATES if name in self.drive}


def read_conditions(path: str | Path) -> dict[str, Condition]:
    """Read the conditions file.

    Returns
    -------
    dict
        Name → condition, in the order of the file.

    Raises
    ------
    InputError
        For unknown keys, values of the wrong type and missing drives.
    """
    expected = "expected a mapping of condition names to their changes"
    content = read_yaml(path, expected)
    if not content:
        raise InputError(path, None, None, expected)
    for name in content:
        check_name(path, name)
    return {name: _condition(path, name, keys or {}) for name, keys in content.items()}


def check_name(file: str | Path, name: str) -> None:
    """Raise `InputError` for a condition name that cannot be stored in a CSV cell unchanged."""
    if not name or name != name.strip() or name.startswith("#") or not name.isprintable():
        remedy = "invalid condition name; use printable characters, no leading # and no leading or trailing spaces"
        raise InputError(file, "condition", name, remedy)


def drive_paths(path: str | Path) -> list[Path]:
    """List the drive files of a conditions file; empty if it cannot be read."""
    try:
        content = read_yaml(path)
    except InputError:
        return []
    drives = [keys.get("drive") for keys in content.values() if isinstance(keys, dict)]
    return [Path(path).parent / str(file) for drive in drives if isinstance(drive, dict) for file in drive.values()]


def _condition(path: str | Path, name: str, keys: Any) -> Condition:
    if not isinstance(keys, dict):
        raise InputError(path, name, keys, "expected a mapping, or nothing for the unmodified network")
    known = [entry.name for entry in fields(Condition) if entry.name != "name"]
    for key in keys:
        if key not in known:
            remedy = f"unknown key; {nearest(key, known)}known: {', '.join(known)}"
            raise InputError(path, f"{name}.{key}", None, remedy)
    held_out = keys.get("held_out", False)
    if not isinstance(held_out, bool):
        raise InputError(path, f"{name}.held_out", held_out, "expected true or false")
    stenosis = _named(keys.get("stenosis") or {})
    if not isinstance(stenosis, dict) or not all(isinstance(label, str) for label in stenosis.values()):
        remedy = "expected {VESSEL: NAME}, with the same NAME wherever it is the same stenosis"
        raise InputError(path, f"{name}.stenosis", stenosis, remedy)
    drive = _named(keys.get("drive") or {})
    if not isinstance(drive, dict):
        raise InputError(path, f"{name}.drive", drive, "expected a mapping of boundary conditions to CSV files")
    return Condition(
        name,
        coronary_resistance_scale=_scale(path, f"{name}.coronary_resistance_scale", keys),
        period_scale=_scale(path, f"{name}.period_scale", keys),
        scale=_factors(path, f"{name}.scale", keys.get("scale") or {}),
        set=_table(path, f"{name}.set", keys.get("set") or {}),
        drive={bc: _drive(path, f"{name}.drive.{bc}", str(file)) for bc, file in drive.items()},
        held_out=held_out,
        free=_free(path, name, keys.get("free") or ()),
        stenosis=stenosis,
        pullback=_pullback(path, name, keys.get("pullback") or {}),
    )


def _pullback(path: str | Path, name: str, keys: Any) -> PullbackErrors:
    defaults = vars(PullbackErrors())
    for key in keys if isinstance(keys, dict) else ("",):
        if key not in defaults:
            raise InputError(path, f"{name}.pullback", keys, f"expected a mapping; known: {', '.join(defaults)}")
    found = {key: _number(path, f"{name}.pullback.{key}", value) for key, value in keys.items()}
    for key, value in found.items():
        if not 0.0 < value <= (1.0 if key == "begins" else np.inf):
            remedy = "expected a positive number" + (" up to 1" if key == "begins" else "")
            raise InputError(path, f"{name}.pullback.{key}", value, remedy)
    return PullbackErrors(**found)


def _named(values: Any) -> Any:
    """Return a mapping to names with names that look like numbers as they are written."""
    return dict(zip(values, texts(values), strict=True)) if isinstance(values, dict) else values


def _scale(path: str | Path, where: str, keys: dict) -> float:
    key = where.rpartition(".")[2]
    number = _number(path, where, keys.get(key, 1.0))
    if number <= 0.0:
        raise InputError(path, where, keys[key], "expected a positive number")
    if not 1.0 / LARGEST_SCALE <= number <= LARGEST_SCALE:
        example = "0.75 for 80 instead of 60 beats/min" if key == "period_scale" else "0.3 for 30 %"
        remedy = f"expected a factor, {1.0 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}; {example}"
        raise InputError(path, where, keys[key], remedy)
    return number


def _free(path: str | Path, name: str, free: Any) -> tuple[str, ...]:
    free = (free,) if isinstance(free, str) else free
    if not isinstance(free, list | tuple):
        raise InputError(path, f"{name}.free", free, f"expected a list of {', '.join(FREE)}")
    for entry in free:
        if entry not in FREE:
            raise InputError(path, f"{name}.free", entry, f"known: {', '.join(FREE)}")
    return tuple(free)


def _factors(path: str | Path, where: str, table: Any) -> dict[str, dict[str, float]]:
    """Return a table of factors, none of them negative; 0 takes an element away."""
    found = _table(path, where, table)
    for block, entry in found.items():
        for parameter, factor in entry.items():
            if factor < 0.0:
                raise InputError(path, f"{where}.{block}.{parameter}", factor, "expected a factor, 0 or more")
    return found


def _table(path: str | Path, where: str, table: Any) -> dict[str, dict[str, float]]:
    if not isinstance(table, dict) or not all(isinstance(entry, dict) for entry in table.values()):
        raise InputError(path, where, table, "expected {BLOCK: {parameter: number}}")
    return {b: {p: _number(path, f"{where}.{b}.{p}", v) for p, v in entry.items()} for b, entry in table.items()}


def _number(path: str | Path, where: str, value: Any) -> float:
    """Convert to a finite number; YAML reads 1e9 and 1.0e9, without a sign in the exponent, as strings."""
    try:
        number = float(value) if not isinstance(value, bool) else np.nan
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(path, where, value, "expected a number" + ", with a point, not a comma" * ("," in str(value)))
    return number


def _drive(conditions: str | Path, where: str, file: str) -> tuple[np.ndarray, np.ndarray]:
    path = Path(conditions).parent / file
    if not path.is_file():
        raise InputError(conditions, where, file, "no such file; give its path relative to the conditions file")
    frame = read_csv(path, ("t", "value"))
    for column in ("t", "value"):
        if not np.issubdtype(frame[column].dtype, np.number) or not np.isfinite(frame[column]).all():
            raise InputError(path, column, None, "expected finite numbers in every row")
    time, value = frame["t"].to_numpy(float), frame["value"].to_numpy(float)
    if len(time) < 5 or (np.diff(time) <= 0).any():
        raise InputError(path, "t", time[:2].tolist(), "expected 5 or more increasing times; are columns swapped?")
    return time - time[0], value


def held_out_names(conditions: dict[str, Condition]) -> list[str]:
    """Return the names of the held-out conditions."""
    return [name for name, condition in conditions.items() if condition.held_out]


def as_entry(condition: Condition) -> dict:
    """Return the entry of a condition in the conditions file, without its drives, which are files."""
    entry = {key: copy.deepcopy(value) for key, value in vars(condition).items() if key not in ("name", "drive")}
    entry |= {"free": list(condition.free), "pullback": dict(vars(condition.pullback))}
    defaults = {**vars(Condition(condition.name)), "free": [], "pullback": vars(PullbackErrors())}
    return {key: value for key, value in entry.items() if value != defaults[key]}


def drive_files(drives: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Return a file for the drive of each (condition, block), relative to the conditions file.

    The files are distinct, also on a file system that ignores case.
    """
    paths: dict[tuple[str, str], str] = {}
    for condition, block in drives:
        stem = plain = re.sub(r"[^\w-]+", "_", f"{condition}_{block}")
        taken, number = {path.lower() for path in paths.values()}, 1
        while f"drives/{stem}.csv".lower() in taken:
            number += 1
            stem = f"{plain}_{number}"
        paths[condition, block] = f"drives/{stem}.csv"
    return paths


def write_conditions(
    folder: Path, entries: dict[str, dict], drives: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]
) -> None:
    """Write `conditions.yaml` and `drives/`. drives: (condition, block) → times and values over one cycle."""
    content = {name: dict(entry) for name, entry in entries.items()}
    for (name, block), path in drive_files(drives).items():
        write_drive(folder / path, *drives[name, block])
        content[name].setdefault("drive", {})[block] = path
    write_text(folder / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))


def write_drive(path: Path, time: np.ndarray, value: np.ndarray) -> None:
    """Write a waveform over one cycle in the format of drives."""
    write_csv(path, pd.DataFrame({"t": time, "value": value}))
