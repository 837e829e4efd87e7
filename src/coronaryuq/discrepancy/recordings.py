"""Recordings of one coronary artery under several conditions, as a case: flow under measured aortic and LV pressure."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from coronaryuq import files, units
from coronaryuq.discrepancy.measurements import LEAST_POINTS
from coronaryuq.errors import InputError
from coronaryuq.files import read_csv

FIRST = "baseline"
HELD_OUT = "_dob"
"""Ending of the conditions that are kept out of every fit: those under dobutamine."""
LARGEST_FLOW = 5.0
"""Mean flow of one coronary artery, mL/s, beyond which a column headed mL/s must hold mL/min: 300 mL/min."""
TIME, AORTA, VENTRICLE, FLOW = "t abs [s]", "AoP [mmHg]", "LVP [mmHg]", "LAD Flow [ml/s]"
"""Headings as recorders write them. The artery may be another, case does not matter, units may be those of `_UNITS`."""
SD_FLOW, SD_SHARE = 1.0, 0.05
"""Standard deviation of flow: two steps of the recorder (mL/min), and a share of the reading's mean."""
SD_MEAN = 0.03
VENOUS = 5.0 * units.MMHG
_NAMES = {TIME: ("t abs", "time", "t"), AORTA: ("aop",), VENTRICLE: ("lvp",)}
_TIMES = {"s": 1.0, "ms": 1e-3}
_PRESSURES = {name.lower(): factor / units.MMHG for name, factor in units.PRESSURES.items()}
_FLOWS = {"ml/s": 1.0, "ml/min": 1.0}
_UNITS = {TIME: _TIMES, AORTA: _PRESSURES, VENTRICLE: _PRESSURES, FLOW: _FLOWS}


def prepare(folder: str | Path, animal: str, out: str | Path) -> None:
    """Write `model.json`, `measurements.csv`, `conditions.yaml` and `drives/` of one animal into `out`.

    Reads every `ANIMAL_CONDITION.csv` of the folder that holds time, aortic and ventricular pressure and flow of one
    beat; see `_recording` for its headings. The model is a vessel, named as the artery, and a bed behind the measured
    aortic pressure, without intramyocardial pressure; its resistance gives the first condition's mean flow. The flow
    column holds mL/min where it would be more than a coronary artery carries in the mL/s of its heading. Every
    condition's coronary resistance is free, set by that condition's mean flow; the waveforms of the conditions under
    dobutamine enter no fit.

    Raises `InputError` for fewer than two conditions, gaps, and times that do not increase.
    """
    folder, out = Path(folder), Path(out)
    if not folder.is_dir():
        raise InputError(folder, None, None, "no such folder; name the one that holds the recordings")
    beats, artery, heading = _beats(folder, animal)
    held_out = [name for name in beats if name.endswith(HELD_OUT)]
    if len(held_out) == len(beats):
        held_out = []
    largest = max(float(np.abs(frame[FLOW]).mean()) for frame in beats.values())
    unit, per_minute = ("mL/min", 1.0) if heading == "ml/min" or largest > LARGEST_FLOW else ("mL/s", 1.0 / 60.0)
    content, rows, first, place = {}, [], None, f"AORTA:{artery}"
    for name, frame in beats.items():
        time = frame[TIME].to_numpy(float) - frame[TIME].iloc[0]
        for block, column in (("AORTA", AORTA), ("LV", VENTRICLE)):
            value = _closed(frame[column].to_numpy()) * units.MMHG
            files.write_csv(out / "drives" / f"{name}_{block}.csv", pd.DataFrame({"t": time, "value": value}))
        content[name] = {
            "drive": {block: f"drives/{name}_{block}.csv" for block in ("AORTA", "LV")},
            "free": ["coronary_resistance_scale"],
        }
        if name in held_out:
            content[name]["held_out"] = True
        flow = frame[FLOW].to_numpy()
        mean = float(np.trapezoid(flow, time) / time[-1])
        sd = float(np.hypot(SD_FLOW * per_minute, SD_SHARE * mean))
        rows += [(name, "flow", place, "waveform", t, q, sd) for t, q in zip(time[:-1], flow[:-1], strict=True)]
        rows.append((name, "flow", place, "mean", "", mean, max(SD_MEAN * abs(mean), 0.3 * per_minute)))
        if first is None:
            first = (time, _closed(frame[AORTA].to_numpy()) * units.MMHG, mean * units.FLOWS[unit])
    table = pd.DataFrame(rows, columns=["condition", "quantity", "location", "statistic", "time", "value", "sd"])
    files.write_csv(out / "measurements.csv", table.assign(unit=unit))
    files.write_text(out / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
    files.write_json(out / "model.json", _network(*first, artery))


def _beats(folder: Path, animal: str) -> tuple[dict[str, pd.DataFrame], str, str]:
    """Condition → one beat's recording, the baseline first; the artery and the unit of flow in the headings."""
    found, headings = {}, {}
    for path in sorted(folder.glob(f"{animal}_*.csv")):
        recording = _recording(path)
        if recording is None:
            continue
        frame, *heading = recording
        if len(frame) < LEAST_POINTS or (np.diff(frame[TIME]) <= 0).any():
            raise InputError(path, TIME, len(frame), f"want at least {LEAST_POINTS} times, increasing, over one beat")
        found[path.stem.removeprefix(f"{animal}_")] = frame
        headings.setdefault(tuple(heading), path)
    if len(found) < 2:
        columns = ", ".join((TIME, AORTA, VENTRICLE, FLOW))
        remedy = f"want {animal}_CONDITION.csv of two conditions at least, with columns {columns}"
        raise InputError(folder, animal, len(found), remedy)
    if len(headings) > 1:
        (first, _), (other, path) = list(headings.items())[:2]
        raise InputError(path, "flow", " ".join(other), f"the other recordings hold {' '.join(first)}; make them agree")
    return dict(sorted(found.items(), key=lambda item: item[0] != FIRST)), *next(iter(headings))


def _recording(path: Path) -> tuple[pd.DataFrame, str, str] | None:
    """One beat with the headings above, its artery and its unit of flow; None for a table of something else.

    Time in s or ms, `AoP` and `LVP` in any unit of pressure, and one column `ARTERY Flow` in mL/s or mL/min, which
    stays in its unit. Raises InputError where one is missing, in another unit, or has gaps.
    """
    frame = read_csv(path)
    parts = {c: re.fullmatch(r"\s*(.*?)\s*\[(.*)\]\s*", str(c).lower()) for c in frame.columns}
    parts = {column: match.groups() for column, match in parts.items() if match}
    flows = [c for c, (name, unit) in parts.items() if re.fullmatch(r"(\w+ )?flow", name) and unit in _FLOWS]
    chosen = {
        wanted: next((c for name in names for c, part in parts.items() if part[0] == name), None)
        for wanted, names in _NAMES.items()
    }
    if not flows and chosen[AORTA] is None and chosen[VENTRICLE] is None:
        return None
    if len(flows) > 1:
        raise InputError(path, "flow", ", ".join(flows), "more than one; leave the column of one artery")
    chosen[FLOW] = flows[0] if flows else None
    beat = {}
    for wanted, column in chosen.items():
        if column is None:
            raise InputError(path, wanted, None, f"column missing; the file has {', '.join(map(str, frame.columns))}")
        factors, unit = _UNITS[wanted], parts[column][1]
        if unit not in factors:
            raise InputError(path, column, unit, f"know {', '.join(factors)}")
        beat[wanted] = pd.to_numeric(frame[column], errors="coerce") * factors[unit]
        if beat[wanted].isna().any():
            raise InputError(path, column, "nan", "a gap in the recording; fill it or leave the beat out")
    name, unit = parts[flows[0]]
    return pd.DataFrame(beat), name.removesuffix("flow").strip() or "artery", unit


def _closed(values: np.ndarray) -> np.ndarray:
    """One beat whose last value is its first: what is left over is spread evenly over the beat."""
    return values - np.linspace(0.0, values[-1] - values[0], len(values))


def _network(time: np.ndarray, pressure: np.ndarray, flow: float, artery: str) -> dict:
    """A vessel and a bed: 0.32, 0.52 and 0.16 of the resistance as in Kim et al., Ann. Biomed. Eng. 38 (2010) 3195."""
    total = (float(np.trapezoid(pressure, time) / time[-1]) - VENOUS) / flow
    bed = {"Ra1": 0.31 * total, "Ra2": 0.52 * total, "Rv1": 0.16 * total, "Ca": 2e-6 * flow, "Cc": 2e-5 * flow}
    bed |= {"P_v": VENOUS, "t": [0.0, float(time[-1])], "Pim": [0.0, 0.0]}
    vessel = {
        "vessel_id": 0,
        "vessel_name": artery,
        "vessel_length": 5.0,
        "boundary_conditions": {"inlet": "AORTA", "outlet": f"BC_{artery}"},
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": 0.01 * total, "L": 20.0, "C": 1e-7},
    }
    return {
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
