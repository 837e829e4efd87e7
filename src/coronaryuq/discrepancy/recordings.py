"""Recordings of one coronary artery under several conditions, as a case: flow under measured aortic and LV pressure."""

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
SD_FLOW, SD_SHARE = 1.0, 0.05
"""Standard deviation of flow: two steps of the recorder (mL/min), and a share of the reading's mean."""
SD_MEAN = 0.03
VENOUS = 5.0 * units.MMHG


def prepare(folder: str | Path, animal: str, out: str | Path) -> None:
    """Write `model.json`, `measurements.csv`, `conditions.yaml` and `drives/` of one animal into `out`.

    Reads every `ANIMAL_CONDITION.csv` of the folder that holds time, aortic and ventricular pressure and flow of one
    beat. The model is a vessel and a bed behind the measured aortic pressure, without intramyocardial pressure; its
    resistance gives the first condition's mean flow. The flow column holds mL/min where it would be more
    than a coronary artery carries in the mL/s of its heading. Every condition's coronary resistance is free, set by
    that condition's mean flow; the waveforms of the conditions under dobutamine enter no fit.

    Raises `InputError` for fewer than two conditions, gaps, and times that do not increase.
    """
    folder, out = Path(folder), Path(out)
    beats = _beats(folder, animal)
    held_out = [name for name in beats if name.endswith(HELD_OUT)]
    if len(held_out) == len(beats):
        held_out = []
    largest = max(float(np.abs(frame[FLOW]).mean()) for frame in beats.values())
    unit, per_minute = ("mL/min", 1.0) if largest > LARGEST_FLOW else ("mL/s", 1.0 / 60.0)
    content, rows, first = {}, [], None
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
        rows += [(name, "flow", "AORTA:lad", "waveform", t, q, sd) for t, q in zip(time[:-1], flow[:-1], strict=True)]
        rows.append((name, "flow", "AORTA:lad", "mean", "", mean, max(SD_MEAN * abs(mean), 0.3 * per_minute)))
        if first is None:
            first = (time, _closed(frame[AORTA].to_numpy()) * units.MMHG, mean * units.FLOWS[unit])
    table = pd.DataFrame(rows, columns=["condition", "quantity", "location", "statistic", "time", "value", "sd"])
    files.write_csv(out / "measurements.csv", table.assign(unit=unit))
    files.write_text(out / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
    files.write_json(out / "model.json", _network(*first))


def _beats(folder: Path, animal: str) -> dict[str, pd.DataFrame]:
    """Condition → one beat's recording, the baseline first."""
    found = {}
    columns = [TIME, AORTA, VENTRICLE, FLOW]
    for path in sorted(folder.glob(f"{animal}_*.csv")):
        frame = read_csv(path)
        if not set(columns[1:]) & set(frame.columns):
            continue
        frame = read_csv(path, tuple(columns))[columns].apply(pd.to_numeric, errors="coerce")
        if frame.isna().any(axis=None):
            raise InputError(path, "waveforms", "nan", "a gap in time, pressure or flow; fill it or leave the beat out")
        if len(frame) < LEAST_POINTS or (np.diff(frame[TIME]) <= 0).any():
            raise InputError(path, TIME, len(frame), f"want at least {LEAST_POINTS} times, increasing, over one beat")
        found[path.stem.removeprefix(f"{animal}_")] = frame
    if len(found) < 2:
        remedy = f"want {animal}_CONDITION.csv of two conditions at least, with columns {', '.join(columns)}"
        raise InputError(folder, animal, len(found), remedy)
    return dict(sorted(found.items(), key=lambda item: item[0] != FIRST))


def _closed(values: np.ndarray) -> np.ndarray:
    """One beat whose last value is its first: what is left over is spread evenly over the beat."""
    return values - np.linspace(0.0, values[-1] - values[0], len(values))


def _network(time: np.ndarray, pressure: np.ndarray, flow: float) -> dict:
    """A vessel and a bed: 0.32, 0.52 and 0.16 of the resistance as in Kim et al., Ann. Biomed. Eng. 38 (2010) 3195."""
    total = (float(np.trapezoid(pressure, time) / time[-1]) - VENOUS) / flow
    bed = {"Ra1": 0.31 * total, "Ra2": 0.52 * total, "Rv1": 0.16 * total, "Ca": 2e-6 * flow, "Cc": 2e-5 * flow}
    bed |= {"P_v": VENOUS, "t": [0.0, float(time[-1])], "Pim": [0.0, 0.0]}
    vessel = {
        "vessel_id": 0,
        "vessel_name": "lad",
        "vessel_length": 5.0,
        "boundary_conditions": {"inlet": "AORTA", "outlet": "BC_lad"},
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
            {"bc_name": "BC_lad", "bc_type": "CORONARY", "bc_values": bed},
        ],
        "vessels": [vessel],
        "junctions": [],
    }
