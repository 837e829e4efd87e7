"""The measurement table: read, checked against the model and converted to series in CGS units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pandas as pd

from coronaryuq.case.network.topology import Topology
from coronaryuq.core import units
from coronaryuq.core.errors import InputError, similar
from coronaryuq.core.io.tables import line_number, read_csv
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.pullbacks import (
    ALONG,
    DRIFT,
    LENGTHS,
    READ,
    Fail,
    as_check,
    check_alone,
    path_of,
    read_pullback,
)
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.pullback import CHECK, OF_WIRE
from coronaryuq.zerod.effects.readings import dense, true_readings

COLUMNS = ("condition", "quantity", "location", "statistic", "time", "value", "sd", "unit")
WORDS = ("condition", "quantity", "location", "statistic", "unit")
PULLBACK_COLUMNS = ("distance", "distance_unit")
"""Further columns, of pullbacks."""
STATISTICS = ("mean", "min", "max", "waveform")
UNITS = {
    "flow": units.FLOWS,
    "pressure": units.PRESSURES,
    "volume": units.VOLUMES,
    "perfusion": units.perfusions(),
    "ratio": units.RATIOS,
    DRIFT: units.PRESSURES,
}
AORTIC = (20.0, 250.0)
"""Plausible mean aortic pressure, mmHg."""
LEAST_POINTS = 8
"""Minimum number of points of a waveform; fewer do not determine its phase."""
WIDEST_GAP = 0.25
"""Largest gap of a waveform over the period; a larger one leaves part of the cycle unmeasured."""
LONGEST = 1.5
"""Longest waveform in cycles; a longer one contains several beats, or its times are not in s."""
LATE = 0.05
"""Fraction of the beat by which a waveform may exceed it."""


@dataclass(frozen=True)
class Measured(Series):
    """One series with its measured values and their standard deviations, (k,), CGS."""

    value: np.ndarray
    sd: np.ndarray

    @property
    def anchors(self) -> bool:
        """Whether it sets the coronary resistance of a condition in which that is free: a mean at one location."""
        return self.statistic == "mean" and self.pullback is None

    @property
    def table_quantity(self) -> str:
        """Quantity in the measurement table."""
        return DRIFT if self.quantity == CHECK else self.quantity.removeprefix(OF_WIRE)


def read_measurements(
    path: str | Path,
    conditions: Mapping[str, Condition],
    locations: dict[str, list[str]],
    periods: dict[str, float],
    topology: Topology,
) -> list[Measured]:
    """Read and check the measurement table.

    Parameters
    ----------
    path
        CSV file with `COLUMNS` and, for pullbacks, `PULLBACK_COLUMNS`.
    conditions
        Known conditions by name, in the order of the conditions file.
    locations
        Quantity → locations of the model.
    periods
        Condition → period, s.
    topology
        Vessels of the network, for pullbacks.

    Returns
    -------
    list of Measured
        Series in the order of the conditions, then of their first rows, in CGS units.

    Raises
    ------
    InputError
        For an unknown condition, quantity, location, statistic or unit, a missing or non-positive standard deviation,
        a waveform that does not cover a cycle, and for pullbacks as `read_pullback` says.
    """
    frame = read_table(path)
    for number, row in zip(frame.index, frame.itertuples(index=False), strict=True):
        _check_row(path, number, row, conditions, locations, topology)
    measured: list[Measured] = []
    pullbacks: list[tuple[str, tuple[str, ...], int]] = []
    checks = frame[frame["quantity"] == DRIFT]
    for key, rows in frame.groupby(["condition", "quantity", "location", "statistic"], sort=False, dropna=False):
        condition, quantity, location, statistic = map(str, key)
        if len(given := rows["unit"].unique()) > 1:
            remedy = "a series has one unit; keep the rows of one sensor"
            raise InputError(path, f"{'/'.join(key)}: unit", ", ".join(given), remedy)
        factor = rows["unit"].astype(str).map(UNITS[quantity]).to_numpy(float)
        value, sd = rows["value"].to_numpy(float) * factor, rows["sd"].to_numpy(float) * factor
        time, pullback, readings, period = None, None, None, periods[condition]
        if quantity in READ and rows["distance"].notna().all():
            own = checks[(checks["condition"] == condition) & (checks["location"] == location)]
            checked_at = next(iter(own["time"].dropna()), None)
            order, pullback = read_pullback(path, rows, topology, conditions[condition], checked_at)
            value, sd, quantity = value[order], sd[order], OF_WIRE + quantity
            pullbacks.append((condition, pullback.path, rows.index[0]))
        elif statistic == "waveform":
            order = np.argsort(rows["time"].to_numpy(float), kind="stable")
            time, value, sd = rows["time"].to_numpy(float)[order], value[order], sd[order]
            _check_waveform(path, key, time, period)
            once = _once(time, period)
            once = once[true_readings(time[once], value[once], sd[once])]
            time, value, sd = time[once], value[once], sd[once]
            _check_waveform(path, key, time, period, "points that neither repeat nor interpolate others")
            if readings := dense(time, period):
                time, value, sd = readings.averaged(time), readings.averaged(value), readings.sd(sd)
        elif len(rows) > 1:
            lines = ", ".join(str(line_number(path, number)) for number in rows.index)
            raise InputError(path, "/".join(key), None, f"lines {lines}: the same measurement; keep one row")
        one = Measured(condition, quantity, location, statistic, time, period, value, sd, pullback=pullback)
        measured.append(replace(one, readings=readings))
    check_alone(path, pullbacks)
    measured = [_with_pullback(path, series, measured) if series.quantity == DRIFT else series for series in measured]
    order_of = {name: number for number, name in enumerate(conditions)}
    return sorted(measured, key=lambda one: order_of[one.condition])


def _with_pullback(path: str | Path, check: Measured, measured: list[Measured]) -> Measured:
    """Return a drift check with the pullback that it belongs to."""
    for series in measured:
        if series.pullback is not None and (series.condition, series.location) == (check.condition, check.location):
            return replace(check, quantity=CHECK, pullback=as_check(series.pullback))
    remedy = "no pullback of this location in this condition to which the drift check could belong"
    raise InputError(path, f"{check.condition}/{DRIFT}: location", check.location, remedy)


def read_table(path: str | Path) -> pd.DataFrame:
    """Read the table with trimmed words, numeric columns where possible, and units in their standard spelling."""
    frame = read_csv(path, words=(*WORDS, "distance_unit"))
    names = [str(name).strip() for name in frame.columns]
    frame.columns = [name if name.lower() in names else name.lower() for name in names]
    duplicates = [name for name in (*COLUMNS, *PULLBACK_COLUMNS) if list(frame.columns).count(name) > 1]
    if duplicates:
        raise InputError(path, duplicates[0], None, "duplicate column; keep one")
    for column in COLUMNS:
        if column != "time" and column not in frame.columns:
            raise InputError(path, column, None, f"column missing; the file has {', '.join(frame.columns)}")
    for column in ("time", *PULLBACK_COLUMNS):
        if column not in frame.columns:
            frame[column] = np.nan
    frame = frame[[*COLUMNS, *PULLBACK_COLUMNS]].dropna(how="all")
    if frame.empty:
        raise InputError(path, None, None, "contains no measurements")
    for column in (*WORDS, "distance_unit"):
        frame[column] = ["" if pd.isna(cell) else str(cell).strip() for cell in frame[column]]
    for column in ("quantity", "statistic"):
        frame[column] = frame[column].str.lower()
    for column in ("time", "value", "sd", "distance"):
        numbers = pd.to_numeric(frame[column], errors="coerce")
        complete = numbers.notna().equals(frame[column].notna())
        frame[column] = numbers if complete else numbers.combine_first(frame[column])
    pairs = zip(frame["unit"], frame["quantity"], strict=True)
    frame["unit"] = [units.standard_unit(unit, UNITS.get(quantity, {})) or unit for unit, quantity in pairs]
    return frame


def _check_row(
    path: str | Path,
    number: int,
    row: Any,
    conditions: Mapping[str, Condition],
    locations: dict[str, list[str]],
    topology: Topology,
) -> None:
    def fail(field: str, value: Any, remedy: str) -> NoReturn:
        raise InputError(path, f"line {line_number(path, number)}: {field}", value, remedy)

    if str(row.condition) not in conditions:
        fail("condition", row.condition, f"not in the conditions file; known: {', '.join(conditions)}")
    if row.quantity not in UNITS:
        fail("quantity", row.quantity, f"known: {', '.join(UNITS)}")
    if row.statistic not in STATISTICS:
        fail("statistic", row.statistic, f"known: {', '.join(STATISTICS)}")
    if row.quantity == "ratio" and row.statistic != "mean":
        fail("statistic", row.statistic, "a ratio is that of mean pressures; use mean")
    if row.quantity == DRIFT and row.statistic != "mean":
        fail("statistic", row.statistic, "a drift check is a difference of mean pressures; use mean")
    if row.quantity == DRIFT or _of_pullback(row, topology):
        path_of(topology, str(row.location), fail)
        if row.quantity != DRIFT:
            _check_distance(row, fail)
    elif not pd.isna(row.distance):
        fail("distance", row.distance, "only the pressure or ratio of a pullback has a distance; remove it")
    elif str(row.location) not in locations[row.quantity]:
        known = locations[row.quantity]
        example = f"for example {', '.join(known[:3])}" if known else "it has none"
        hint = similar(row.location, known) or example
        fail("location", row.location, f"the model has no such {row.quantity} location; {hint}")
    if str(row.unit) not in UNITS[row.quantity]:
        fail("unit", row.unit, f"not a unit of {row.quantity}; known: {', '.join(UNITS[row.quantity])}")
    if not _number(row.value):
        fail("value", row.value, "expected a number; remove rows without one")
    if not _number(row.sd) or row.sd <= 0:
        fail("sd", row.sd, "expected a positive standard deviation in the unit of the value")
    if row.statistic == "waveform" and not _number(row.time):
        fail("time", None if pd.isna(row.time) else row.time, "a waveform needs the time within the cycle, s")


def _of_pullback(row: Any, topology: Topology) -> bool:
    """Whether a row belongs to a pullback: its location is a vessel, or a path of vessels."""
    named = ALONG in str(row.location) or str(row.location) in topology.vessels
    return row.quantity in READ and (named or not pd.isna(row.distance))


def _check_distance(row: Any, fail: Fail) -> None:
    if row.statistic == "waveform":
        fail("statistic", row.statistic, "a pullback has mean, min or max")
    if not _number(row.distance):
        fail("distance", row.distance, "expected the distance along the centreline from the start of the first vessel")
    if row.distance_unit not in LENGTHS:
        fail("distance_unit", row.distance_unit or None, f"expected the unit of distance: {' or '.join(LENGTHS)}")


def _number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and bool(np.isfinite(value))


def _check_waveform(path: str | Path, key: Iterable, time: np.ndarray, period: float, points: str = "points") -> None:
    where = "/".join(map(str, key))
    if len(time) < LEAST_POINTS:
        remedy = f"expected at least {LEAST_POINTS} over the cycle; add points or give the mean"
        raise InputError(path, f"{where}: number of {points}", len(time), remedy)
    if np.ptp(time) > LONGEST * period:
        remedy = f"{np.ptp(time) / period:.3g} cycles of {period:.4g} s; give one beat with times in s"
        raise InputError(path, f"{where}: time span (s)", float(np.ptp(time)), remedy)
    if time[0] < 0.0 or time[-1] > (1.0 + LATE) * period:
        remedy = f"outside the beat of {period:.4g} s; give times in s from its start, or set period_scale"
        raise InputError(path, f"{where}: time (s)", float(time[0] if time[0] < 0.0 else time[-1]), remedy)
    if (np.diff(time) == 0.0).any():
        duplicate = float(time[np.argmin(np.diff(time))])
        raise InputError(path, f"{where}: time", duplicate, "duplicate time; keep one row")
    phase = np.sort(time % period)
    gap = float(max(np.diff(phase, append=phase[0] + period)) / period)
    if gap > WIDEST_GAP:
        remedy = f"the waveform does not cover the cycle of {period:.4g} s; give the whole cycle, or set the "
        remedy += "condition's period_scale"
        raise InputError(path, f"{where}: largest gap over period", round(gap, 3), remedy)


def _once(time: np.ndarray, period: float) -> np.ndarray:
    """Return which samples (k,) are the first of their phase: the end of a beat is often repeated as its start is."""
    phase = np.round(time / period % 1.0, 6) % 1.0
    return np.sort(np.unique(phase, return_index=True)[1])


def measured_conditions(measured: list[Measured]) -> list[str]:
    """Return the names of the measured conditions in their order."""
    return list(dict.fromkeys(series.condition for series in measured))
