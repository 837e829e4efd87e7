"""Recordings of one coronary artery under several conditions, as a case: flow under measured aortic and LV pressure."""

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import line_number, read_csv, write_csv
from coronaryuq.discrepancy.data.conditions import BED_SHAPE, LOSS, RESISTANCE, check_name
from coronaryuq.discrepancy.data.measurements import AORTIC, LEAST_POINTS, WIDEST_GAP
from coronaryuq.zerod.effects.grafting import put_ahead
from coronaryuq.zerod.effects.quadratic import TAG

FIRST = ("baseline", "rest", "control")
"""Conditions whose mean flow gives the model's resistance, where there is one of them."""
STENOSED = re.compile(r"sten", re.IGNORECASE)
DRUG = re.compile(r"[_ -]?dob[a-z]*[_ -]?\d*$", re.IGNORECASE)
STENOSIS = 0.3
"""Guess of such a stenosis' loss at the reference flow, over the mean aortic pressure."""
HELD_OUT = re.compile(r"(^|.*[_ -])dob[a-z]*[_ -]?\d*", re.IGNORECASE)
"""Conditions that are kept out of every fit where none are named: those under dobutamine."""
LARGEST_FLOW = 5.0
"""Mean flow of one coronary artery, mL/s, beyond which a column headed mL/s must hold mL/min: 300 mL/min."""
TIME, AORTA, VENTRICLE, FLOW = "t abs [s]", "AoP [mmHg]", "LVP [mmHg]", "LAD Flow [ml/s]"
"""Headings as recorders write them. The artery may be another, case does not matter, units may be those of `_UNITS`."""
SD_FLOW, SD_SHARE = 1.0, 0.05
"""Standard deviation of flow: two steps of the recorder (mL/min), and a share of the reading's mean."""
SD_MEAN = 0.03
USED_PER_SECOND = 150.0
"""Readings of flow that are used of a second, about, where there are more: noise of readings closer in time is not
independent, as it counts here, and curves drawn through them tell nothing more."""
SHORTEST, LONGEST = 0.1, 3.0
"""Lengths of a beat, s, from a small animal's to a slow heart's."""
LARGEST_JUMP = 0.25
"""Difference of a pressure's ends, over its range, beyond which a recording is no whole beat."""
VENOUS = 5.0 * units.MMHG
_NAMES = {TIME: ("t abs", "time", "t"), AORTA: ("aop",), VENTRICLE: ("lvp",)}
_TIMES = {"s": 1.0, "ms": 1e-3}
_PRESSURES = {name.lower(): factor / units.MMHG for name, factor in units.PRESSURES.items()}
_FLOWS = {"ml/s": 1.0, "ml/min": 1.0}
_UNITS = {TIME: _TIMES, AORTA: _PRESSURES, VENTRICLE: _PRESSURES, FLOW: _FLOWS}


def prepare(
    folder: str | Path, animal: str, out: str | Path, held_out: Sequence[str] | None = None, free_bed: bool = False
) -> None:
    """Write `model.json`, `measurements.csv`, `conditions.yaml` and `drives/` of one animal into `out`.

    Reads every `ANIMAL_CONDITION.csv` of the folder that holds time, aortic and ventricular pressure and flow of one
    beat; see `_recording` for its headings. The model is a vessel, named as the artery, and a bed behind the measured
    aortic pressure, without intramyocardial pressure; its resistance gives the mean flow of one of `FIRST`, or of the
    condition of median resistance. The flow column holds mL/min where it would be more than a coronary artery carries
    in the mL/s of its heading. Every condition's coronary resistance is free, set by that condition's mean flow; the
    waveforms of the conditions of `held_out`, by default those under dobutamine, enter no fit. free_bed: how resistance
    and compliance lie along the bed is free as well, and conditions whose names hold `sten` have a stenosis of unknown
    severity, the same one where the rest of the name is the same but for the drug.

    Raises `InputError` for fewer than two conditions, gaps, times that do not increase, no whole beat or several, and
    what no coronary artery has.
    """
    folder, out = Path(folder), Path(out)
    if not folder.is_dir():
        raise InputError(folder, None, None, "no such folder; name the one that holds the recordings")
    beats, artery, heading = _beats(folder, animal)
    for name in held_out or ():
        if name not in beats:
            raise InputError(folder, "held_out", name, f"no such condition of {animal}; know {', '.join(beats)}")
    if held_out is None:
        held_out = [name for name in beats if HELD_OUT.fullmatch(name)]
        held_out = [] if len(held_out) == len(beats) else held_out
    if len(held_out) == len(beats):
        raise InputError(folder, "held_out", ", ".join(held_out), "all conditions; leave one at least to be fitted")
    largest = max(float(np.abs(frame[FLOW]).mean()) for frame in beats.values())
    unit, per_minute = ("mL/min", 1.0) if heading == "ml/min" or largest > LARGEST_FLOW else ("mL/s", 1.0 / 60.0)
    if heading == "ml/s" and unit == "mL/min":
        note = f"note: {folder}: {animal}: flow headed ml/s, {largest:.3g} on average, is read as mL/min"
        print(note, file=sys.stderr, flush=True)
    if largest < SD_FLOW * per_minute:
        remedy = f"{unit} on average, less than the error of such a flow ({SD_FLOW * per_minute:.2g}); see its unit"
        raise InputError(folder, f"{animal}: flow", float(f"{largest:.3g}"), remedy)
    reference, narrow = _reference(beats, unit), f"{artery}_{TAG}"
    stenosed = [name for name in beats if free_bed and STENOSED.search(name)]
    guess = STENOSIS * float(np.trapezoid(reference[1], reference[0]) / reference[0][-1]) / reference[2] ** 2
    content, rows, place = {}, [], f"AORTA:{narrow if stenosed else artery}"
    for name, frame in beats.items():
        time = frame[TIME].to_numpy(float) - frame[TIME].iloc[0]
        for block, column in (("AORTA", AORTA), ("LV", VENTRICLE)):
            value = _closed(frame[column].to_numpy()) * units.MMHG
            write_csv(out / "drives" / f"{name}_{block}.csv", pd.DataFrame({"t": time, "value": value}))
        content[name] = {
            "drive": {block: f"drives/{name}_{block}.csv" for block in ("AORTA", "LV")},
            "free": [RESISTANCE, BED_SHAPE] if free_bed else [RESISTANCE],
        }
        if name in held_out:
            content[name]["held_out"] = True
        if name in stenosed:
            content[name]["set"] = {narrow: {LOSS: guess}}
            content[name]["stenosis"] = {narrow: DRUG.sub("", name) or name}
        flow = frame[FLOW].to_numpy()
        mean = float(np.trapezoid(flow, time) / time[-1])
        sd = float(np.hypot(SD_FLOW * per_minute, SD_SHARE * mean))
        every = max(1, round((len(time) - 1) / time[-1] / USED_PER_SECOND))
        readings = zip(time[:-1:every], flow[:-1:every], strict=True)
        rows += [(name, "flow", place, "waveform", t, q, sd) for t, q in readings]
        rows.append((name, "flow", place, "mean", "", mean, max(SD_MEAN * abs(mean), 0.3 * per_minute)))
    table = pd.DataFrame(rows, columns=["condition", "quantity", "location", "statistic", "time", "value", "sd"])
    write_csv(out / "measurements.csv", table.assign(unit=unit))
    write_text(out / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
    network = _network(*reference, artery)
    if stenosed:
        # An element of its own, as losses of vessels that store blood are everywhere.
        network = put_ahead(network, artery, TAG)
        network.vessel_values(narrow)[LOSS] = 0.0
    write_json(out / "model.json", network)


def _reference(beats: dict[str, pd.DataFrame], unit: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Time (s), aortic pressure (dyn/cm2) and mean flow (mL/s) of the condition that the model's numbers are of."""

    def means(frame):
        return [float(np.trapezoid(frame[column], frame[TIME]) / np.ptp(frame[TIME])) for column in (AORTA, FLOW)]

    resistance = {name: means(frame)[0] / means(frame)[1] for name, frame in beats.items()}
    ranked = sorted(resistance, key=lambda name: resistance[name])
    frame = beats[next((name for name in FIRST if name in beats), ranked[(len(ranked) - 1) // 2])]
    time = frame[TIME].to_numpy(float) - frame[TIME].iloc[0]
    return time, _closed(frame[AORTA].to_numpy()) * units.MMHG, means(frame)[1] * units.FLOWS[unit]


def _beats(folder: Path, animal: str) -> tuple[dict[str, pd.DataFrame], str, str]:
    """Condition → one beat's recording, the baseline first; the artery and the unit of flow in the headings."""
    found, headings = {}, {}
    for path in sorted(folder.glob(f"{animal}_*.csv")):
        recording = _recording(path)
        if recording is None:
            continue
        frame, *heading = recording
        _check_beat(path, frame)
        check_name(path, path.stem.removeprefix(f"{animal}_"))
        found[path.stem.removeprefix(f"{animal}_")] = frame
        headings.setdefault(tuple(heading), path)
    if len(found) < 2:
        columns = ", ".join((TIME, AORTA, VENTRICLE, FLOW))
        remedy = f"want {animal}_CONDITION.csv of two conditions at least, with columns {columns}"
        raise InputError(folder, animal, len(found), remedy)
    if len(headings) > 1:
        (first, _), (other, path) = list(headings.items())[:2]
        raise InputError(path, "flow", " ".join(other), f"the other recordings hold {' '.join(first)}; make them agree")
    _check_names(folder, animal, list(found))
    return dict(sorted(found.items(), key=lambda item: item[0] not in FIRST)), *next(iter(headings))


def _check_names(folder: Path, animal: str, conditions: list[str]) -> None:
    """Raise `InputError` where the files of another animal, whose name begins with this one's, are among them."""
    prefix, cut, _ = os.path.commonprefix(conditions).rpartition("_")
    if cut and any(name.removeprefix(f"{prefix}_") in FIRST for name in conditions):
        raise InputError(folder, animal, None, f"no such animal; did you mean {animal}_{prefix}?")
    cuts = (name[: cut.start()] for name in conditions for cut in re.finditer("_", name))
    for prefix in dict.fromkeys(cuts):
        theirs = [
            name for name in conditions if name.startswith(f"{prefix}_") and name[len(prefix) + 1 :] in conditions
        ]
        if len(theirs) > 1:
            other = f"{animal}_{prefix}"
            remedy = f"{', '.join(theirs)} look like conditions of {other}; give each animal a folder, or another name"
            raise InputError(folder, animal, len(conditions), remedy)


def _check_beat(path: Path, frame: pd.DataFrame) -> None:
    """Raise `InputError` unless this may be one whole beat of a coronary artery."""
    time, aorta, ventricle = (frame[column].to_numpy(float) for column in (TIME, AORTA, VENTRICLE))
    # The last is the first of the next beat.
    if len(frame) <= LEAST_POINTS:
        raise InputError(path, TIME, len(frame), f"want at least {LEAST_POINTS + 1} times over one beat")
    if (np.diff(time) <= 0).any():
        row = int(np.argmax(np.diff(time) <= 0)) + 1
        raise InputError(
            path,
            TIME,
            float(time[row]),
            f"line {line_number(path, row)}: times must increase; sort the table",
        )
    if not SHORTEST <= time[-1] - time[0] <= LONGEST:
        remedy = f"want one beat, {SHORTEST} to {LONGEST} s; see the unit of time"
        raise InputError(path, TIME, float(time[-1] - time[0]), remedy)
    gap = float(np.diff(time).max() / (time[-1] - time[0]))
    if gap > WIDEST_GAP:
        raise InputError(
            path, TIME, f"{gap:.0%}", "of the beat without a reading; leave the beat out, or cut out another"
        )
    if not AORTIC[0] <= aorta.mean() <= AORTIC[1]:
        remedy = f"mmHg on average, want {AORTIC[0]:g} to {AORTIC[1]:g}; see its unit"
        raise InputError(path, AORTA, round(float(aorta.mean()), 3), remedy)
    if ventricle.mean() > aorta.mean():
        remedy = f"mmHg on average, above the aorta's {aorta.mean():.3g}; are the two exchanged?"
        raise InputError(path, VENTRICLE, round(float(ventricle.mean()), 3), remedy)
    if frame[FLOW].mean() <= 0.0:
        remedy = "on average; turn the sign if the probe was reversed"
        raise InputError(path, FLOW, round(float(frame[FLOW].mean()), 3), remedy)
    systoles = _systoles(ventricle)
    if systoles != 1:
        raise InputError(path, VENTRICLE, systoles, "systoles in the recording; cut out one beat, or average them")
    for name, values in ((AORTA, aorta), (VENTRICLE, ventricle)):
        jump = abs(values[-1] - values[0]) / np.ptp(values)
        if jump > LARGEST_JUMP:
            raise InputError(path, name, f"{jump:.0%}", "of its range from end to start; want one whole beat")


def _systoles(pressure: np.ndarray) -> int:
    """How often the pressure rises from below 30 to above 70 % of its range, going round."""
    share = (pressure - pressure.min()) / max(np.ptp(pressure), 1e-12)
    high = np.where(share > 0.7, 1, np.where(share < 0.3, 0, -1))
    states = high[high >= 0]
    return int(np.sum(np.diff(states, append=states[0]) == 1)) if len(states) else 0


def _recording(path: Path) -> tuple[pd.DataFrame, str, str] | None:
    """One beat with the headings above, its artery and its unit of flow; None for a table of something else.

    Time in s or ms, `AoP` and `LVP` in any unit of pressure, and one column `ARTERY Flow` in mL/s or mL/min, which
    stays in its unit. Raises InputError where one is missing, in another unit, or has gaps.
    """
    frame = read_csv(path)
    parts = {c: re.fullmatch(r"\s*(.*?)\s*[\[(](.*)[\])]\s*", str(c).lower()) for c in frame.columns}
    parts = {column: match.groups() for column, match in parts.items() if match}
    flows = [c for c, (name, unit) in parts.items() if re.fullmatch(r"(\w+ )?flow", name) and unit in _FLOWS]
    chosen = {
        wanted: next((c for name in names for c, part in parts.items() if part[0] == name), None)
        for wanted, names in _NAMES.items()
    }
    if not flows and chosen[AORTA] is None and chosen[VENTRICLE] is None:
        bare = [c for c in frame.columns if re.fullmatch(r"\s*(aop|lvp|(\w+ )?flow)\s*", str(c).lower())]
        if bare:
            raise InputError(path, bare[0], None, f"no unit in the heading; write {AORTA}, {VENTRICLE}, {FLOW}")
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
        if not np.isfinite(beat[wanted]).all():
            row = int(np.argmax(~np.isfinite(beat[wanted])))
            given = frame[column].iloc[row]
            remedy = f"line {line_number(path, row)}: want a number in every row; fill the gap or leave the beat out"
            raise InputError(path, column, None if pd.isna(given) else str(given), remedy)
    name, unit = parts[flows[0]]
    return pd.DataFrame(beat), name.removesuffix("flow").strip() or "artery", unit


def _closed(values: np.ndarray) -> np.ndarray:
    """One beat whose last value is its first: what is left over is spread evenly over the beat."""
    return values - np.linspace(0.0, values[-1] - values[0], len(values))


def _network(time: np.ndarray, pressure: np.ndarray, flow: float, artery: str) -> Network:
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
