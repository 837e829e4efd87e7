"""Recordings of one coronary artery under several conditions, converted to a case driven by measured pressures."""

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import line_number, read_csv, write_csv
from coronaryuq.core.io.text import visible
from coronaryuq.discrepancy.data.beat import AORTA, FLOW, TIME, VENTRICLE, check_beat
from coronaryuq.discrepancy.data.conditions import BED_SHAPE, RESISTANCE, check_name, write_drive
from coronaryuq.zerod.effects.grafting import put_ahead
from coronaryuq.zerod.effects.quadratic import TAG
from coronaryuq.zerod.effects.readings import PER_SECOND
from coronaryuq.zerod.network.differences import LOSS

REFERENCE = ("baseline", "rest", "control")
"""Conditions whose mean flow sets the resistance of the model, if one of them is recorded."""
STENOSED = re.compile(r"sten", re.IGNORECASE)
DRUG = re.compile(r"[_ -]?dob[a-z]*[_ -]?\d*$", re.IGNORECASE)
STENOSIS = 0.3
"""Initial loss of such a stenosis at the reference flow, over the mean aortic pressure."""
HELD_OUT = re.compile(r"(^|.*[_ -])dob[a-z]*[_ -]?\d*", re.IGNORECASE)
"""Conditions held out by default: those under dobutamine."""
LARGEST_FLOW = 5.0
"""Mean flow of one coronary artery, mL/s, above which a column headed mL/s must contain mL/min."""
SD_FLOW, SD_SHARE = 1.0, 0.05
"""Standard deviation of flow: two steps of the recorder (mL/min), and a fraction of the mean."""
SD_MEAN = 0.03
VENOUS = 5.0 * units.MMHG
_NAMES = {TIME: ("t abs", "time", "t"), AORTA: ("aop",), VENTRICLE: ("lvp",)}
_TIMES = {"s": 1.0, "ms": 1e-3}
_PRESSURES = {name.lower(): factor / units.MMHG for name, factor in units.PRESSURES.items()}
_FLOWS = {"ml/s": 1.0, "ml/min": 1.0}
_UNITS = {TIME: _TIMES, AORTA: _PRESSURES, VENTRICLE: _PRESSURES, FLOW: _FLOWS}


def prepare_case(
    folder: str | Path, animal: str, out_dir: str | Path, held_out: Sequence[str] | None = None, free_bed: bool = False
) -> tuple[Path, Path, Path]:
    """Write the case of one recorded animal: `model.json`, `measurements.csv`, `conditions.yaml` and `drives/`.

    The model is a vessel, named as the artery, and a bed, driven by the measured aortic pressure and without
    intramyocardial pressure. Its resistance gives the mean flow of one of `REFERENCE`, or of the condition of median
    resistance. The coronary resistance of every condition is free, set by its mean flow. A flow larger than that of a
    coronary artery in the mL/s of its heading is read as mL/min.

    Parameters
    ----------
    folder
        Folder of `ANIMAL_CONDITION.csv`, each one beat of time, aortic and ventricular pressure, and flow.
    animal
        Name of the animal in the file names.
    out_dir
        Folder for the case.
    held_out
        Conditions whose waveforms enter no fit; by default those under dobutamine.
    free_bed
        Calibrate the distribution of resistance and compliance along the bed as well, and a stenosis of unknown
        severity in conditions whose names contain `sten`, common to names that differ only in the drug.

    Returns
    -------
    model, measurements, conditions
        The files.

    Raises
    ------
    InputError
        For fewer than two conditions, gaps, times that do not increase, recordings that are not one whole beat, and
        values that are implausible for a coronary artery.
    """
    folder, out = Path(folder), Path(out_dir)
    model, measurements, conditions = (out / name for name in ("model.json", "measurements.csv", "conditions.yaml"))
    if not folder.is_dir():
        raise InputError(folder, None, None, "no such folder; give the folder of the recordings")
    beats, artery, heading = _beats(folder, animal)
    held_out = _held_out(folder, animal, list(beats), held_out)
    unit, per_minute = _flow_unit(folder, animal, beats, heading)
    reference, stenosis_vessel = _reference(beats, unit), f"{artery}_{TAG}"
    stenosed = [name for name in beats if free_bed and STENOSED.search(name)]
    loss = STENOSIS * float(np.trapezoid(reference[1], reference[0]) / reference[0][-1]) / reference[2] ** 2
    location = f"AORTA:{stenosis_vessel if stenosed else artery}"
    content, rows = {}, []
    for name, frame in beats.items():
        time = frame[TIME].to_numpy(float) - frame[TIME].iloc[0]
        entry: dict[str, Any] = {"drive": {}, "free": [RESISTANCE, BED_SHAPE] if free_bed else [RESISTANCE]}
        for block, column in (("AORTA", AORTA), ("LV", VENTRICLE)):
            path = entry["drive"][block] = f"drives/{name}_{block}.csv"
            write_drive(out / path, time, _closed(frame[column].to_numpy()) * units.MMHG)
        if name in held_out:
            entry["held_out"] = True
        if name in stenosed:
            entry["set"] = {stenosis_vessel: {LOSS: loss}}
            entry["stenosis"] = {stenosis_vessel: DRUG.sub("", name) or name}
        content[name] = entry
        rows += [(name, "flow", location, *row) for row in _flow_rows(time, frame[FLOW].to_numpy(), per_minute)]
    table = pd.DataFrame(rows, columns=["condition", "quantity", "location", "statistic", "time", "value", "sd"])
    write_csv(measurements, table.assign(unit=unit))
    write_text(conditions, yaml.safe_dump(content, sort_keys=False))
    network = _network(*reference, artery)
    if stenosed:
        # A separate vessel, because the artery stores blood.
        network = put_ahead(network, artery, TAG)
        network.vessel_values(stenosis_vessel)[LOSS] = 0.0
    write_json(model, network)
    return model, measurements, conditions


def _held_out(folder: Path, animal: str, conditions: list[str], held_out: Sequence[str] | None) -> list[str]:
    for name in held_out or ():
        if name not in conditions:
            raise InputError(folder, "held_out", name, f"no such condition of {animal}; known: {', '.join(conditions)}")
    if held_out is None:
        held_out = [name for name in conditions if HELD_OUT.fullmatch(name)]
        held_out = [] if len(held_out) == len(conditions) else held_out
    if len(held_out) == len(conditions):
        raise InputError(folder, "held_out", ", ".join(held_out), "all conditions; leave at least one to be fitted")
    return list(held_out)


def _flow_unit(folder: Path, animal: str, beats: dict[str, pd.DataFrame], heading: str) -> tuple[str, float]:
    """Return the unit of the flow column, and one mL/min in it."""
    means = {name: float(np.abs(frame[FLOW]).mean()) for name, frame in beats.items()}
    least, largest = min(means, key=lambda name: means[name]), max(means.values())
    unit, per_minute = ("mL/min", 1.0) if heading == "ml/min" or largest > LARGEST_FLOW else ("mL/s", 1.0 / 60.0)
    if heading == "ml/s" and unit == "mL/min" and means[least] < SD_FLOW:
        remedy = f"mL/s as its heading says, or mL/min as {largest:.3g} elsewhere; write the unit in every heading"
        raise InputError(folder / f"{animal}_{least}.csv", "mean flow", float(f"{means[least]:.3g}"), remedy)
    if heading == "ml/s" and unit == "mL/min":
        note = f"note: {folder}: {animal}: flow with heading ml/s, mean {largest:.3g}, is read as mL/min"
        print(note, file=sys.stderr, flush=True)
    if largest < SD_FLOW * per_minute:
        remedy = f"below the error of a flow reading ({SD_FLOW * per_minute:.2g}); check the unit"
        raise InputError(folder, f"{animal}: mean flow ({unit})", float(f"{largest:.3g}"), remedy)
    return unit, per_minute


def _flow_rows(time: np.ndarray, flow: np.ndarray, per_minute: float) -> list[tuple[str, Any, float, float]]:
    """Statistic, time, value and standard deviation of the used readings and of their mean."""
    mean = float(np.trapezoid(flow, time) / time[-1])
    sd = float(np.hypot(SD_FLOW * per_minute, SD_SHARE * mean))
    # Left out, not averaged: neighbouring readings of a recorder share errors, and interpolated ones say nothing.
    every = max(1, round((len(time) - 1) / time[-1] / PER_SECOND))
    waveform = [("waveform", t, q, sd) for t, q in zip(time[:-1:every], flow[:-1:every], strict=True)]
    return [*waveform, ("mean", "", mean, max(SD_MEAN * abs(mean), 0.3 * per_minute))]


def _reference(beats: dict[str, pd.DataFrame], unit: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Time (s), aortic pressure (dyn/cm2) and mean flow (mL/s) of the condition that sets the values of the model."""

    def means(frame: pd.DataFrame) -> list[float]:
        return [float(np.trapezoid(frame[column], frame[TIME]) / np.ptp(frame[TIME])) for column in (AORTA, FLOW)]

    resistance = {name: means(frame)[0] / means(frame)[1] for name, frame in beats.items()}
    ranked = sorted(resistance, key=lambda name: resistance[name])
    frame = beats[next((name for name in REFERENCE if name in beats), ranked[(len(ranked) - 1) // 2])]
    time = frame[TIME].to_numpy(float) - frame[TIME].iloc[0]
    return time, _closed(frame[AORTA].to_numpy()) * units.MMHG, means(frame)[1] * units.FLOWS[unit]


def _beats(folder: Path, animal: str) -> tuple[dict[str, pd.DataFrame], str, str]:
    """Condition → recorded beat, the baseline first; the artery and the unit of flow in the headings."""
    beats: dict[str, pd.DataFrame] = {}
    headings: dict[tuple[str, str], Path] = {}
    for path in visible(folder, f"{animal}_*.csv"):
        recording = _recording(path)
        if recording is None:
            continue
        frame, artery, unit = recording
        check_beat(path, frame)
        condition = path.stem.removeprefix(f"{animal}_")
        check_name(path, condition)
        beats[condition] = frame
        headings.setdefault((artery, unit), path)
    if len(beats) < 2:
        columns = ", ".join((TIME, AORTA, VENTRICLE, FLOW))
        remedy = f"expected at least two files {animal}_CONDITION.csv, with columns {columns}"
        raise InputError(folder, f"{animal}: number of conditions", len(beats), remedy)
    if len(headings) > 1:
        (first, _), (other, path) = list(headings.items())[:2]
        remedy = f"the other recordings contain {' '.join(first)}; make them agree"
        raise InputError(path, "flow", " ".join(other), remedy)
    _check_names(folder, animal, list(beats))
    return dict(sorted(beats.items(), key=lambda item: item[0] not in REFERENCE)), *next(iter(headings))


def _check_names(folder: Path, animal: str, conditions: list[str]) -> None:
    """Raise `InputError` if files of another animal, whose name begins with this one's, are among them."""
    prefix, cut, _ = os.path.commonprefix(conditions).rpartition("_")
    if cut and any(name.removeprefix(f"{prefix}_") in REFERENCE for name in conditions):
        raise InputError(folder, animal, None, f"no such animal; did you mean {animal}_{prefix}?")
    cuts = (name[: cut.start()] for name in conditions for cut in re.finditer("_", name))
    for prefix in dict.fromkeys(cuts):
        others = [
            name for name in conditions if name.startswith(f"{prefix}_") and name[len(prefix) + 1 :] in conditions
        ]
        if len(others) > 1:
            remedy = f"{', '.join(others)} look like conditions of {animal}_{prefix}; put each animal in its own "
            raise InputError(folder, animal, len(conditions), remedy + "folder, or rename one")


def _recording(path: Path) -> tuple[pd.DataFrame, str, str] | None:
    """Read one beat, its artery and its unit of flow; None if the table is not a recording.

    Time in s or ms, `AoP` and `LVP` in any unit of pressure, and one column `ARTERY Flow` in mL/s or mL/min, which
    stays in its unit. Raises `InputError` if one is missing, in another unit, or has gaps.
    """
    frame = read_csv(path)
    matches = {c: re.fullmatch(r"\s*(.*?)\s*[\[(](.*)[\])]\s*", str(c).lower()) for c in frame.columns}
    parts = {column: (match[1], match[2]) for column, match in matches.items() if match}
    flows = [c for c, (name, unit) in parts.items() if re.fullmatch(r"(\w+ )?flow", name) and unit in _FLOWS]
    chosen = {
        wanted: next((c for name in names for c, part in parts.items() if part[0] == name), None)
        for wanted, names in _NAMES.items()
    }
    if not flows and chosen[AORTA] is None and chosen[VENTRICLE] is None:
        bare = [c for c in frame.columns if re.fullmatch(r"\s*(aop|lvp|(\w+ )?flow)\s*", str(c).lower())]
        if bare:
            raise InputError(path, bare[0], None, f"no unit in the heading; use {AORTA}, {VENTRICLE}, {FLOW}")
        return None
    if len(flows) > 1:
        raise InputError(path, "flow", ", ".join(flows), "more than one; keep the column of one artery")
    chosen[FLOW] = flows[0] if flows else None
    beat = {}
    for wanted, column in chosen.items():
        if column is None:
            raise InputError(path, wanted, None, f"column missing; the file has {', '.join(map(str, frame.columns))}")
        factors, unit = _UNITS[wanted], parts[column][1]
        if unit not in factors:
            raise InputError(path, column, unit, f"unknown unit; known: {', '.join(factors)}")
        beat[wanted] = pd.to_numeric(frame[column], errors="coerce") * factors[unit]
        if not np.isfinite(beat[wanted]).all():
            row = int(np.argmax(~np.isfinite(beat[wanted])))
            given = frame[column].iloc[row]
            remedy = f"line {line_number(path, row)}: expected a number; fill the gap or remove the recording"
            raise InputError(path, column, None if pd.isna(given) else str(given), remedy)
    name, unit = parts[flows[0]]
    return pd.DataFrame(beat), name.removesuffix("flow").strip() or "artery", unit


def _closed(values: np.ndarray) -> np.ndarray:
    """Make a beat periodic by spreading the difference between its ends evenly over it."""
    return values - np.linspace(0.0, values[-1] - values[0], len(values))


def _network(time: np.ndarray, pressure: np.ndarray, flow: float, artery: str) -> Network:
    """Make a vessel and a bed with 0.32, 0.52 and 0.16 of the resistance (Kim et al., Ann. Biomed. Eng. 38 (2010))."""
    total = (float(np.trapezoid(pressure, time) / time[-1]) - VENOUS) / flow
    bed: dict[str, Any] = {
        "Ra1": 0.31 * total,
        "Ra2": 0.52 * total,
        "Rv1": 0.16 * total,
        "Ca": 2e-6 * flow,
        "Cc": 2e-5 * flow,
    }
    bed |= {"P_v": VENOUS, "t": [0.0, float(time[-1])], "Pim": [0.0, 0.0]}
    vessel = {
        "vessel_id": 0,
        "vessel_name": artery,
        "vessel_length": 5.0,
        "boundary_conditions": {"inlet": "AORTA", "outlet": f"BC_{artery}"},
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": 0.01 * total, "L": 20.0, "C": 1e-7},
    }
    return Network(
        {
            "simulation_parameters": {
                "number_of_cardiac_cycles": 10,
                "number_of_time_pts_per_cardiac_cycle": 401,
                "absolute_tolerance": 1e-8,
                "steady_initial": True,
            },
            "boundary_conditions": [
                {"bc_name": "AORTA", "bc_type": "PRESSURE", "bc_values": {"t": time.tolist(), "P": pressure.tolist()}},
                {"bc_name": f"BC_{artery}", "bc_type": "CORONARY", "bc_values": bed},
            ],
            "vessels": [vessel],
            "junctions": [],
        }
    )
