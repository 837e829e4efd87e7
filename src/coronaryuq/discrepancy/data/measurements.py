"""The measurement table: read, checked against the model, and turned into series in the network's units."""

import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core import units
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import line_number, read_csv
from coronaryuq.zerod.effects.base import Series

COLUMNS = ("condition", "quantity", "location", "statistic", "time", "value", "sd", "unit")
WORDS = ("condition", "quantity", "location", "statistic", "unit")
STATISTICS = ("mean", "min", "max", "waveform")
UNITS = {
    "flow": units.FLOWS,
    "pressure": units.PRESSURES,
    "volume": units.VOLUMES,
    "perfusion": units.perfusions(),
    "ratio": units.RATIOS,
}
AORTIC = (20.0, 250.0)
"""Mean pressure, mmHg, that an aorta can have."""
LEAST_POINTS = 8
"""Fewest points of a waveform; with fewer its phase cannot be told."""
WIDEST_GAP = 0.25
"""Widest gap of a waveform over the period; a wider one leaves part of the cycle unmeasured."""
LONGEST = 1.5
"""Longest waveform in cycles: beyond it the times are those of many beats, or not in s."""
LATE = 0.05
"""Share of the beat by which a waveform may end beyond it."""


@dataclass(frozen=True)
class Measured(Series):
    """One series with its measured values and their standard deviations, (k,), CGS."""

    value: np.ndarray = None
    sd: np.ndarray = None


def read_measurements(path: str | Path, conditions, locations: dict[str, list[str]], periods: dict[str, float]):
    """Read and check the table; returns a list of `Measured` in the order of its rows, CGS.

    conditions: known names. locations: per quantity, the model's names. periods: s, per condition.
    Raises `InputError` for an unknown condition, quantity, location, statistic or unit, a missing or non-positive
    sd, and a waveform that does not cover a cycle.
    """
    frame = _table(path)
    for number, row in zip(frame.index, frame.itertuples(index=False), strict=True):
        _check_row(path, number, row, conditions, locations)
    found = []
    for key, rows in frame.groupby(["condition", "quantity", "location", "statistic"], sort=False, dropna=False):
        condition, quantity, location, statistic = map(str, key)
        factor = rows["unit"].astype(str).map(UNITS[quantity]).to_numpy(float)
        value, sd = rows["value"].to_numpy(float) * factor, rows["sd"].to_numpy(float) * factor
        time = None
        if statistic == "waveform":
            order = np.argsort(rows["time"].to_numpy(float), kind="stable")
            time, value, sd = rows["time"].to_numpy(float)[order], value[order], sd[order]
            _check_waveform(path, key, time, periods[condition])
        elif len(rows) > 1:
            raise InputError(path, "/".join(key), len(rows), "given more than once; keep one row")
        found.append(Measured(condition, quantity, location, statistic, time, periods[condition], value, sd))
    return found


def _table(path: str | Path) -> pd.DataFrame:
    """The table with words trimmed, numbers as numbers where they are, and units in this project's spelling."""
    frame = read_csv(path, words=WORDS)
    names = [str(name).strip() for name in frame.columns]
    frame.columns = [name if name.lower() in names else name.lower() for name in names]
    twice = [name for name in COLUMNS if list(frame.columns).count(name) > 1]
    if twice:
        raise InputError(path, twice[0], None, "two columns of that name; leave one")
    if "time" not in frame.columns:
        frame["time"] = np.nan
    for column in COLUMNS:
        if column not in frame.columns:
            raise InputError(path, column, None, f"column missing; the file has {', '.join(frame.columns)}")
    frame = frame[list(COLUMNS)].dropna(how="all")
    if frame.empty:
        raise InputError(path, None, None, "holds no measurement")
    for column in WORDS:
        frame[column] = ["" if pd.isna(cell) else str(cell).strip() for cell in frame[column]]
    for column in ("quantity", "statistic"):
        frame[column] = frame[column].str.lower()
    for column in ("time", "value", "sd"):
        numbers = pd.to_numeric(frame[column], errors="coerce")
        frame[column] = (
            numbers if numbers.notna().equals(frame[column].notna()) else numbers.combine_first(frame[column])
        )
    frame["unit"] = [
        _spelled(unit, UNITS.get(quantity, {})) for unit, quantity in zip(frame["unit"], frame["quantity"], strict=True)
    ]
    return frame


def _spelled(unit: str, known: dict[str, float]) -> str:
    """A unit as the table of units writes it: case, blanks, carets and a missing unit of a ratio do not matter."""

    def plain(text):
        return text.lower().replace(" ", "").replace("^", "").replace("·", "").replace("dyne", "dyn")

    if not unit and "1" in known:
        return "1"
    return next((name for name in known if plain(name) == plain(unit)), unit)


def _check_row(path, number: int, row, conditions, locations) -> None:
    def fail(field, value, remedy):
        raise InputError(path, f"line {line_number(path, number)}: {field}", value, remedy)

    if str(row.condition) not in conditions:
        fail("condition", row.condition, f"not in the conditions file; know {', '.join(conditions)}")
    if row.quantity not in UNITS:
        fail("quantity", row.quantity, f"know {', '.join(UNITS)}")
    if row.statistic not in STATISTICS:
        fail("statistic", row.statistic, f"know {', '.join(STATISTICS)}")
    if row.quantity == "ratio" and row.statistic != "mean":
        fail("statistic", row.statistic, "a ratio is of mean pressures; want mean")
    if str(row.location) not in locations[row.quantity]:
        near = difflib.get_close_matches(str(row.location), locations[row.quantity], n=3, cutoff=0.3)
        known = locations[row.quantity]
        hint = f"near: {', '.join(near)}" if near else f"such as {', '.join(known[:3])}" if known else "it has none"
        fail("location", row.location, f"the model has no such {row.quantity} location; {hint}")
    if str(row.unit) not in UNITS[row.quantity]:
        fail("unit", row.unit, f"not a unit of {row.quantity}; know {', '.join(UNITS[row.quantity])}")
    if not _number(row.value):
        fail("value", row.value, "want a number; leave a row without one out")
    if not _number(row.sd) or row.sd <= 0:
        fail("sd", row.sd, "want the standard deviation of the measurement, a positive number in the unit of the value")
    if row.statistic == "waveform" and not _number(row.time):
        fail("time", row.time, "want the time within the cycle, s")


def _number(value) -> bool:
    return isinstance(value, int | float | np.number) and bool(np.isfinite(value))


def _check_waveform(path, key, time: np.ndarray, period: float) -> None:
    where = "/".join(map(str, key))
    if len(time) < LEAST_POINTS:
        raise InputError(path, where, len(time), f"a waveform needs at least {LEAST_POINTS} points over the cycle")
    if np.ptp(time) > LONGEST * period:
        remedy = f"times span {np.ptp(time) / period:.3g} cycles of {period:.4g} s; give one beat, times in s"
        raise InputError(path, where, float(np.ptp(time)), remedy)
    if time[0] < 0.0 or time[-1] > (1.0 + LATE) * period:
        remedy = f"beyond the beat of {period:.4g} s; count times from its start, in s, or give the period_scale"
        raise InputError(path, where, float(time[0] if time[0] < 0.0 else time[-1]), remedy)
    if (np.diff(time) == 0.0).any():
        twice = float(time[np.argmin(np.diff(time))])
        raise InputError(path, f"{where}: time", twice, "given more than once; keep one row")
    phase = np.sort(time % period)
    gap = float(max(np.diff(phase, append=phase[0] + period)) / period)
    if gap > WIDEST_GAP:
        raise InputError(
            path,
            where,
            round(gap, 3),
            f"waveform does not cover the cycle of {period:.4g} s: a gap of {gap:.0%}; give it whole, "
            "or the condition's period_scale",
        )


def measured_conditions(measured: list[Measured]) -> list[str]:
    return list(dict.fromkeys(series.condition for series in measured))
