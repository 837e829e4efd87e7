"""Conditions under which the measurements were taken, and what each changes in the network."""

import copy
import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from coronaryuq.case.description.yaml_file import read_yaml
from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.beds import arteriolar
from coronaryuq.zerod.effects.drive import DRIVES

SERIES = DRIVES | {"CORONARY": "Pim", "CORONARY_VAR_RES": "Pim"}
"""The waveform that a drive replaces in each kind of boundary condition."""
COVARIATES = ("LV",)
"""Measured waveforms that a drive may name although they are no block: left ventricular pressure."""
RESISTANCE, BED_SHAPE = "coronary_resistance_scale", "bed_shape"
LOSS = "stenosis_coefficient"
ELEMENTS = ("R_poiseuille", "L", "C", LOSS)
"""Of a vessel; nought where the file leaves them out."""
FREE = (RESISTANCE, BED_SHAPE)
"""What may be unknown: of a condition its coronary resistance; of all together how resistance and compliance lie along
the beds."""
LARGEST_SCALE = 20.0
"""Factor on a coronary resistance or a period, or one over it, beyond which it is a percentage or mistyped."""
LARGEST_DRIVE = 6.0
"""Times the network's own mean pressure that a drive may have; kPa and mmHg are 7.5 apart."""
SAME_BEAT = 0.02
"""Share by which a drive may be longer or shorter than the beat that a period_scale says."""


@dataclass(frozen=True)
class Condition:
    """One condition of the YAML file; see docs/discrepancy.md for the keys."""

    name: str
    coronary_resistance_scale: float = 1.0
    period_scale: float = 1.0
    scale: dict[str, dict[str, float]] = field(default_factory=dict)
    set: dict[str, dict[str, float]] = field(default_factory=dict)
    drive: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    held_out: bool = False
    free: tuple[str, ...] = ()
    stenosis: dict[str, str] = field(default_factory=dict)

    @property
    def anchored(self) -> bool:
        """Whether its own mean values have to set its coronary resistance."""
        return RESISTANCE in self.free

    @property
    def covariates(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Over one cycle; their times may be of another period than the condition's."""
        return {name: self.drive[name] for name in COVARIATES if name in self.drive}


def read_conditions(path: str | Path) -> dict[str, Condition]:
    """Read the conditions file: name → keys. Raises `InputError` for unknown keys, wrong types and missing drives."""
    wanted = "want a mapping of condition names to what each changes"
    content = read_yaml(path, wanted)
    if not content:
        raise InputError(path, None, None, wanted)
    for name in content:
        check_name(path, name)
    return {name: _condition(path, name, keys or {}) for name, keys in content.items()}


def check_name(file: str | Path, name: str) -> None:
    """Raise `InputError` for a condition's name that a cell of a table cannot hold as it is."""
    if not name or name != name.strip() or name.startswith("#") or not name.isprintable():
        remedy = "not a condition's name; want letters, without # or blanks before them or blanks behind"
        raise InputError(file, "condition", name, remedy)


def drives_of(path: str | Path) -> list[Path]:
    """The files that the drives of a conditions file are read from; none where it cannot be read."""
    try:
        content = read_yaml(path)
    except InputError:
        return []
    drives = [keys.get("drive") for keys in content.values() if isinstance(keys, dict)]
    return [Path(path).parent / str(file) for drive in drives if isinstance(drive, dict) for file in drive.values()]


def _condition(path, name: str, keys: dict) -> Condition:
    if not isinstance(keys, dict):
        raise InputError(path, name, keys, "want a mapping, or nothing for the network as it is")
    known = ("coronary_resistance_scale", "period_scale", "scale", "set", "drive", "held_out", "free", "stenosis")
    for key in keys:
        if key not in known:
            raise InputError(path, f"{name}.{key}", None, f"unknown key; know {', '.join(known)}")
    numbers = {}
    for key in ("coronary_resistance_scale", "period_scale"):
        numbers[key] = _number(path, f"{name}.{key}", keys.get(key, 1.0))
        if numbers[key] <= 0.0:
            raise InputError(path, f"{name}.{key}", keys[key], "want a positive number")
        if not 1.0 / LARGEST_SCALE <= numbers[key] <= LARGEST_SCALE:
            remedy = f"a factor, {1.0 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}; 0.3 for 30 %"
            raise InputError(path, f"{name}.{key}", keys[key], remedy)
    if not isinstance(keys.get("held_out", False), bool):
        raise InputError(path, f"{name}.held_out", keys["held_out"], "want true or false")
    tables = {key: _table(path, f"{name}.{key}", keys.get(key) or {}) for key in ("scale", "set")}
    free = keys.get("free") or ()
    free = (free,) if isinstance(free, str) else free
    if not isinstance(free, list | tuple):
        raise InputError(path, f"{name}.free", free, f"want a list, of {', '.join(FREE)}")
    for entry in free:
        if entry not in FREE:
            raise InputError(path, f"{name}.free", entry, f"know {', '.join(FREE)}")
    stenosis = keys.get("stenosis") or {}
    if not isinstance(stenosis, dict) or not all(isinstance(one, str) for one in stenosis.values()):
        raise InputError(
            path, f"{name}.stenosis", stenosis, "want {VESSEL: NAME}, one NAME wherever it is the same one"
        )
    drive = keys.get("drive") or {}
    if not isinstance(drive, dict):
        raise InputError(path, f"{name}.drive", drive, "want a mapping of boundary conditions to CSV files")
    waveforms = {bc: _drive(Path(path).parent / str(file)) for bc, file in drive.items()}
    return Condition(
        name,
        **numbers,
        **tables,
        drive=waveforms,
        held_out=keys.get("held_out", False),
        free=tuple(free),
        stenosis=stenosis,
    )


def _table(path, where: str, table) -> dict[str, dict[str, float]]:
    if not isinstance(table, dict) or not all(isinstance(entry, dict) for entry in table.values()):
        raise InputError(path, where, table, "want {BLOCK: {parameter: number}}")
    return {b: {p: _number(path, f"{where}.{b}.{p}", v) for p, v in entry.items()} for b, entry in table.items()}


def _number(path, where: str, value) -> float:
    """A finite number; YAML takes 1e9 and 1.0e9, without a sign in the exponent, for words."""
    try:
        number = float(value) if not isinstance(value, bool) else np.nan
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(path, where, value, "want a number")
    return number


def is_number(value) -> bool:
    """Whether a value of a network is a number, and neither a waveform nor a flag."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _drive(path: Path) -> tuple[np.ndarray, np.ndarray]:
    frame = read_csv(path, ("t", "value"))
    for column in ("t", "value"):
        if not np.issubdtype(frame[column].dtype, np.number) or not np.isfinite(frame[column]).all():
            raise InputError(path, column, None, "want finite numbers in every row")
    time, value = frame["t"].to_numpy(float), frame["value"].to_numpy(float)
    if len(time) < 5 or (np.diff(time) <= 0).any():
        raise InputError(path, "t", None, "want at least 5 times, increasing, over one cycle")
    return time - time[0], value


def kept_out(conditions: dict[str, Condition]) -> list[str]:
    """Names of those that enter no fit."""
    return [name for name, condition in conditions.items() if condition.held_out]


def as_entry(condition: Condition) -> dict:
    """A condition as the conditions file has it, but for its drives, which are files."""
    entry: dict = {}
    for key in ("coronary_resistance_scale", "period_scale"):
        if getattr(condition, key) != 1.0:
            entry[key] = getattr(condition, key)
    for key in ("scale", "set"):
        if getattr(condition, key):
            entry[key] = copy.deepcopy(getattr(condition, key))
    if condition.held_out:
        entry["held_out"] = True
    if condition.free:
        entry["free"] = list(condition.free)
    if condition.stenosis:
        entry["stenosis"] = dict(condition.stenosis)
    return entry


def drive_files(wanted: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """(condition, block) → where that drive is written, beside the conditions file; no two are one file, also where
    case does not count.
    """
    found: dict[tuple[str, str], str] = {}
    for condition, block in wanted:
        stem = plain = re.sub(r"[^\w-]+", "_", f"{condition}_{block}")
        taken, number = {name.lower() for name in found.values()}, 1
        while f"drives/{stem}.csv".lower() in taken:
            number += 1
            stem = f"{plain}_{number}"
        found[condition, block] = f"drives/{stem}.csv"
    return found


def write_drive(path: Path, time: np.ndarray, value: np.ndarray) -> None:
    """Write a waveform over one cycle as the conditions file's `drive` reads it."""
    import pandas as pd

    write_csv(path, pd.DataFrame({"t": time, "value": value}))


def period_of(network: Network, default: float = 1.0) -> float:
    """Cardiac period (s): the heart's, or that of the first waveform."""
    if network.closed_loop:
        return float(network.heart["cardiac_cycle_period"])
    pulsing = [b["bc_values"] for b in network.boundary_conditions if b["bc_type"] in SERIES]
    for values in sorted((v for v in pulsing if len(v["t"]) > 1), key=lambda v: -len(v["t"])):
        return float(values["t"][-1] - values["t"][0])
    return float(network["simulation_parameters"].get("cardiac_period", default))


def under(network: Network, condition: Condition, file: str | Path = "conditions") -> Network:
    """The network under a condition; `file` names the conditions file in error messages."""
    network = network.deep_copy()
    anatomy = Anatomy(network)
    period = period_of(network)
    vessels = {name: vessel["zero_d_element_values"] for name, vessel in anatomy.vessels.items()}
    elements = {name: values for part, name, _, values in network.elements() if part != "junctions"}
    factor = condition.coronary_resistance_scale
    for bed in anatomy.beds:
        anatomy.blocks[bed]["bc_values"].update({k: v * factor for k, v in arteriolar(network, bed).items()})
    for key, combine in (("scale", lambda old, new: old * new), ("set", lambda old, new: new)):
        for block, entry in getattr(condition, key).items():
            for parameter, value in entry.items():
                values = elements.get(block)
                if values is None:
                    near = difflib.get_close_matches(block, [*vessels, *anatomy.blocks], n=3, cutoff=0.3)
                    remedy = "the network has no such block" + (f"; near: {', '.join(near)}" if near else "")
                    raise InputError(file, f"{condition.name}.{key}.{block}", None, remedy)
                # Where an effect has put CORONARY_VAR_RES in the place of CORONARY, one Ra2 has become two.
                split = [f"{parameter}_min", f"{parameter}_max"]
                for name in split if parameter not in values and all(one in values for one in split) else [parameter]:
                    if name in ELEMENTS and values is vessels.get(block):
                        values.setdefault(name, 0.0)
                    if name not in values or not is_number(values[name]):
                        known = ", ".join(k for k, v in values.items() if is_number(v))
                        raise InputError(file, f"{condition.name}.{key}.{block}.{name}", None, f"know {known}")
                    values[name] = combine(values[name], value)
    for vessel, name in condition.stenosis.items():
        values = vessels.get(vessel)
        where = f"{condition.name}.stenosis.{vessel}"
        if values is None:
            known = ", ".join(vessels)
            raise InputError(file, where, name, f"the network has no such vessel; know {known}")
        if values.get("C", 0.0) > 0.0:
            raise InputError(file, where, name, "the vessel has a C; put a vessel without one ahead of it for the loss")
        if not values.get(LOSS, 0.0) > 0.0:
            raise InputError(file, where, name, f"want a guess of its loss; set {vessel}'s {LOSS} under this condition")
    for name in COVARIATES:
        if name in condition.drive and name in {*vessels, *anatomy.blocks}:
            remedy = "the left ventricular pressure of a drive, and a block of the network; name that block otherwise"
            raise InputError(file, f"{condition.name}.drive.{name}", None, remedy)
    driven = {name: waveform for name, waveform in condition.drive.items() if name not in COVARIATES}
    target = _own_period(condition, period, file)
    for name, (time, value) in driven.items():
        block = anatomy.blocks.get(name)
        if block is None or block["bc_type"] not in SERIES:
            known = ", ".join([b for b, v in anatomy.blocks.items() if v["bc_type"] in SERIES] + list(COVARIATES))
            raise InputError(file, f"{condition.name}.drive.{name}", None, f"no block with a waveform; know {known}")
        if block["bc_type"] == "PRESSURE":
            own, given = (float(np.abs(np.mean(values))) for values in (block["bc_values"]["P"], value))
            if own > 0.0 and not 1.0 / LARGEST_DRIVE <= given / own <= LARGEST_DRIVE:
                remedy = "times the network's own on average; want the network's unit of pressure"
                raise InputError(file, f"{condition.name}.drive.{name}", float(f"{given / own:.3g}"), remedy)
        block["bc_values"]["t"], block["bc_values"][SERIES[block["bc_type"]]] = time.tolist(), value.tolist()
    _set_period(network, target)
    return network


def _own_period(condition: Condition, period: float, file: str | Path) -> float:
    """The condition's period (s): its drives', but where a `period_scale` is given beside them.

    Then they may be of the condition's own beat or of the network's, whose period is `period`, to be made as short.
    What is no boundary condition but a measured waveform sets no period; it is of the beat that the others have.
    """
    target = period * condition.period_scale
    lengths = {name: float(waveform[0][-1]) for name, waveform in condition.drive.items()}
    driving = [length for name, length in lengths.items() if name not in COVARIATES]
    if condition.period_scale == 1.0 and driving:
        target = driving[0]
    for name, length in lengths.items():
        where = f"{condition.name}.drive.{name}"
        if condition.period_scale == 1.0:
            allowed = SAME_BEAT if name in COVARIATES else 1e-9
            if abs(length - target) > allowed * target:
                remedy = f"s long; want {target:.4g}, as the other drives" if driving else f"s long; want {target:.4g}"
                raise InputError(file, where, length, remedy)
        elif min(abs(length - one) / one for one in (period, target)) > SAME_BEAT:
            remedy = (
                f"s long; beside a period_scale want the network's beat ({period:.4g}) or this one's ({target:.4g})"
            )
            raise InputError(file, where, length, remedy)
    return target


def _set_period(network: Network, period: float) -> None:
    if network.closed_loop:
        network.heart["cardiac_cycle_period"] = period
    for block in network.boundary_conditions:
        if block["bc_type"] in SERIES:
            time = np.asarray(block["bc_values"]["t"], dtype=float)
            if len(time) > 1:
                time = (time - time[0]) / (time[-1] - time[0]) * period
                time[-1] = period
                block["bc_values"]["t"] = time.tolist()
    if "cardiac_period" in network["simulation_parameters"]:
        network["simulation_parameters"]["cardiac_period"] = period
