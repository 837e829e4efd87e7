"""Recordings of one coronary artery under several conditions, as a case: flow under measured aortic and LV pressure."""

from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from coronaryuq import files, units
from coronaryuq.errors import InputError
from coronaryuq.files import read_csv

CONDITIONS = ("baseline", "mild_sten", "mild_sten_dob", "mod_sten", "mod_sten_dob")
HELD_OUT = ("mild_sten_dob", "mod_sten_dob")
TIME, AORTA, VENTRICLE, FLOW = "t abs [s]", "AoP [mmHg]", "LVP [mmHg]", "LAD Flow [ml/s]"
SD_FLOW, SD_SHARE = 1.0, 0.05
"""Standard deviation of flow: two steps of the recorder (mL/min), and a share of the reading's mean."""
SD_MEAN = 0.03
VENOUS = 5.0 * units.MMHG


def prepare(folder: str | Path, animal: str, out: str | Path, conditions=CONDITIONS, held_out=HELD_OUT) -> None:
    """Write `model.json`, `measurements.csv`, `conditions.yaml` and `drives/` of one animal into `out`.

    The model is a vessel and a bed behind the measured aortic pressure, without intramyocardial pressure; its
    resistance gives the first condition's mean flow. The flow column holds mL/min whatever its heading says: taken as
    mL/s it would be more than the heart's output. Every condition's coronary resistance is free, set by
    that condition's mean flow; the waveforms of the held-out conditions enter no fit.
    """
    folder, out = Path(folder), Path(out)
    content, rows, first = {}, [], None
    for name in conditions:
        path = folder / f"{animal}_{name}.csv"
        frame = read_csv(path, (TIME, AORTA, VENTRICLE, FLOW))
        if frame[[TIME, AORTA, VENTRICLE, FLOW]].isna().any(axis=None):
            raise InputError(path, "waveforms", "nan", "a gap in time, pressure or flow; fill it or leave the beat out")
        time = frame[TIME].to_numpy() - frame[TIME].iloc[0]
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
        sd = float(np.hypot(SD_FLOW, SD_SHARE * mean))
        rows += [(name, "flow", "AORTA:lad", "waveform", t, q, sd) for t, q in zip(time[:-1], flow[:-1], strict=True)]
        rows.append((name, "flow", "AORTA:lad", "mean", "", mean, max(SD_MEAN * mean, 0.3)))
        if first is None:
            first = (time, _closed(frame[AORTA].to_numpy()) * units.MMHG, mean * units.ML_PER_MIN)
    table = pd.DataFrame(rows, columns=["condition", "quantity", "location", "statistic", "time", "value", "sd"])
    files.write_csv(out / "measurements.csv", table.assign(unit="mL/min"))
    files.write_text(out / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
    files.write_json(out / "model.json", _network(*first))


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
