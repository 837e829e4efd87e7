"""Pullbacks of a pressure wire in the measurement table: paths, distances and drift, checked against the model."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import networkx as nx
import numpy as np
import pandas as pd

from coronaryuq.case.network.topology import Topology
from coronaryuq.core import units
from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.io.tables import line_number, read_csv
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.zerod.effects.pullback import Pullback

ALONG = ">"
"""Separates the vessels of a path, from proximal to distal."""
DRIFT = "drift"
"""Quantity of the drift check in the measurement table."""
READ = ("pressure", "ratio")
"""Quantities that a wire reads."""
LENGTHS = {"mm": units.MM, "cm": 1.0}
LEAST_READINGS = 3
"""Minimum number of readings of a pullback; fewer show no course."""
BEYOND = 0.05
"""Distance by which a reading may exceed the path, cm; it is then one at its end."""

Fail = Callable[[str, Any, str], NoReturn]


def path_of(topology: Topology, location: str, fail: Fail) -> tuple[str, ...]:
    """Return the vessels of a path, including those between two that it names.

    Parameters
    ----------
    topology
        Vessels of the network.
    location
        A vessel, or vessels separated by `ALONG`, from proximal to distal.
    fail
        Called with field, value and remedy of what is wrong.
    """
    named = [part.strip() for part in location.split(ALONG)]
    for vessel in named:
        if vessel not in topology.vessels:
            remedy = f"no such vessel in the network; {nearest(vessel, topology.vessels)}expected VESSEL or FIRST>LAST"
            fail("location", location, remedy)
    path = [named[0]]
    for vessel in named[1:]:
        if vessel == path[-1] or not nx.has_path(topology.graph, path[-1], vessel):
            remedy = f"{vessel} is not downstream of {path[-1]}; name vessels from proximal to distal"
            fail("location", location, remedy)
        path += nx.shortest_path(topology.graph, path[-1], vessel)[1:]
    for vessel in path:
        length = topology.vessels[vessel].get("vessel_length")
        if not isinstance(length, int | float) or isinstance(length, bool) or not 0.0 <= length < np.inf:
            fail("location", location, f"the network has no vessel_length (cm) of {vessel}; add it")
    return tuple(path)


def read_pullback(
    path: str | Path, rows: pd.DataFrame, topology: Topology, condition: Condition, checked_at: float | None
) -> tuple[np.ndarray, Pullback]:
    """Return the order of the rows by distance, and their pullback.

    The drift of the wire grows linearly in time since its equalisation. Where the rows have no time, the wire is pulled
    at an even speed, and the pullback begins when the fraction `begins` of the time to its end has passed.

    Parameters
    ----------
    path
        The measurement table, for messages.
    rows
        Rows of one pullback, in the order of the file.
    topology
        Vessels of the network.
    condition
        The condition of the pullback.
    checked_at
        Time of the drift check, s since equalisation; None: when the last reading was taken.

    Raises
    ------
    InputError
        For distances that turn round, or lie beyond the path, and for times that only some rows have.
    """
    first = line_number(path, rows.index[0])

    def fail(field: str, value: Any, remedy: str, line: int = first) -> NoReturn:
        raise InputError(path, f"line {line}: {field}", value, remedy)

    vessels = path_of(topology, str(rows["location"].iloc[0]), fail)
    if len(rows) < LEAST_READINGS:
        remedy = f"a pullback needs at least {LEAST_READINGS} readings; or give a pressure by BLOCK:BLOCK"
        fail("distance", len(rows), remedy)
    distance = rows["distance"].to_numpy(float) * rows["distance_unit"].map(LENGTHS).to_numpy(float)
    length = sum(topology.length(vessel) for vessel in vessels)
    for row, along in zip(rows.index, distance, strict=True):
        if not 0.0 <= along <= length + BEYOND:
            remedy = f"expected 0 to {length / units.MM:.4g} mm, the length of {ALONG.join(vessels)}; check the unit"
            fail("distance (mm)", float(f"{along / units.MM:.4g}"), remedy, line_number(path, row))
    steps = np.diff(distance)
    turned = np.flatnonzero(np.sign(steps) != np.sign(distance[-1] - distance[0]))
    if turned.size:
        line = line_number(path, rows.index[turned[0] + 1])
        along = float(f"{distance[turned[0] + 1] / units.MM:.4g}")
        remedy = "turns round or repeats; give one pullback of a vessel in each condition, in the order of its readings"
        fail("distance (mm)", along, remedy, line)
    order = np.argsort(distance, kind="stable")
    errors, time = condition.pullback, rows["time"]
    weight = _weights(time, distance, errors.begins, checked_at, fail)
    return order, Pullback(
        vessels,
        distance[order],
        length,
        units.MMHG * weight[order],
        errors.drift_sd,
        errors.noise_length * units.MM,
        time=time.to_numpy(float)[order] if time.notna().all() else None,
    )


def _weights(time: pd.Series, distance: np.ndarray, begins: float, checked_at: float | None, fail: Fail) -> np.ndarray:
    """Return the fraction of the drift at the end that each reading has, (k,)."""
    given = time.notna()
    if not given.any():
        passed = (distance.max() - distance) / np.ptp(distance)
        return begins + (1.0 - begins) * passed
    if not given.all():
        fail("time", None, "some readings of this pullback have a time; give s since equalisation for all, or for none")
    seconds = time.to_numpy(float)
    end = seconds.max() if checked_at is None else checked_at
    if seconds.min() < 0.0 or end < seconds.max() or seconds.max() == 0.0:
        worst = seconds.min() if seconds.min() < 0.0 else seconds.max()
        fail("time", float(worst), f"expected s since equalisation, up to the drift check ({end:.4g} s)")
    return seconds / end


def as_check(pullback: Pullback) -> Pullback:
    """Return the drift check of a pullback: one reading, with the whole drift."""
    drift = np.full(1, units.MMHG)
    time = None if pullback.time is None else pullback.time.max() * drift / pullback.drift.max()
    return replace(pullback, distance=np.zeros(1), drift=drift, root_pressure=1.0, time=time)


def check_alone(path: str | Path, paths: Sequence[tuple[str, tuple[str, ...], int]]) -> None:
    """Raise `InputError` for two pullbacks to one vessel in one condition; entries: condition, path and first row."""
    known: dict[tuple[str, str], str] = {}
    for condition, vessels, row in paths:
        key, name = (condition, vessels[-1]), ALONG.join(vessels)
        if key in known:
            remedy = f"another pullback to {vessels[-1]} under {condition} ({known[key]}); keep one, with one statistic"
            raise InputError(path, f"line {line_number(path, row)}: location", name, remedy)
        known[key] = name


def has_pullback(table: str | Path) -> bool:
    """Whether a measurement table has readings with a distance; False if it cannot be read, or is yet to be made."""
    try:
        frame = read_csv(table)
    except InputError:
        return False
    return any(str(name).strip().lower() == "distance" and frame[name].notna().any() for name in frame.columns)
