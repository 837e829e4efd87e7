"""The model with the named effects, or without wiring errors: network, conditions, measurements, list of changes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.core import units
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition, as_entry, write_conditions
from coronaryuq.discrepancy.data.measurements import COLUMNS, PULLBACK_COLUMNS, UNITS
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import element_factors
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.forward.pullbacks import extents
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.zerod.effects.grafting import renamed_again
from coronaryuq.zerod.effects.pullback import CHECK
from coronaryuq.zerod.effects.wiring_error import WiringError
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.differences import scalars

Drives = dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]
"""(condition, block) → times and values of a drive."""
SAME = 1e-9
"""Relative tolerance below which a value is unchanged."""
WRITTEN_IN = {
    "flow": "mL/s",
    "pressure": "mmHg",
    "volume": "mL",
    "perfusion": "mL/min/g",
    "ratio": "1",
    "drift": "mmHg",
}
"""Unit of each quantity in the measurement table of a repaired network."""
REPAIRED, REWIRED = "repaired.json", "rewired.json"
CHANGED = ("vessels", "boundary_conditions", "closed_loop_blocks")
"""Parts of a network whose values effects and recalibration change."""


def repaired_network(forward: Forward, hypothesis: Hypothesis, z: np.ndarray) -> Network:
    """Return the unconditioned network with the elements and values of the effects, recalibrated to z (p,)."""
    plain = Condition("unmodified")
    simulation = forward.simulation.changed(conditions={plain.name: plain})
    alone = replace(forward, simulation=simulation, measured=[], shapes=None)
    table, structure = alone.condition_changes(plain.name, z, hypothesis)
    network = with_changes(structure, {**table, **_by_vessels(forward, z, scalars(structure) | table)})
    network = network.deep_copy()
    if forward.anatomy.closed_loop and (state := alone.initial_state(plain.name, z, hypothesis)):
        # Only an initial state can give a closed loop the blood volume of the fit.
        network["initial_condition"] = state
        network["simulation_parameters"]["steady_initial"] = False
    for name, (start, end) in extents(hypothesis, hypothesis.physical_sizes(z), forward.anatomy).items():
        network.vessel(name)["placed_in"] = {"start": start, "end": end}
    return network


def _by_vessels(forward: Forward, z: np.ndarray, values: dict[str, Any]) -> dict[str, float]:
    """Return the values of the vessels' elements with the errors that the fit found, of those among some values."""
    factors = element_factors(forward.nuisances, z)
    return {target: float(values[target]) * factor for target, factor in factors.items() if target in values}


def repaired_conditions(forward: Forward, hypothesis: Hypothesis, z: np.ndarray) -> tuple[dict[str, dict], Drives]:
    """Return the entries of the conditions file of the repaired network, and drives by condition and block.

    What an effect or the recalibration changes in a single condition is written as `set`, a waveform as a drive, so
    that the repaired network under the new conditions reproduces the fit.
    """
    network = repaired_network(forward, hypothesis, z)
    entries: dict[str, dict] = {}
    waves: Drives = {}
    for name, condition in forward.conditions.items():
        entry = as_entry(condition)
        fitted, _ = forward.condition_changes(name, z, hypothesis)
        fitted |= _by_vessels(forward, z, fitted)
        present = scalars(apply_condition(network, condition))
        drives = dict(condition.drive)
        for parameter, value in fitted.items():
            block, _, key = parameter.rpartition(".")
            if np.ndim(value):
                drives[block] = np.linspace(0.0, forward.periods[name], len(value)), np.asarray(value)
            elif abs(present.get(parameter, 0.0) - float(value)) > SAME * abs(float(value)):
                entry.setdefault("set", {}).setdefault(block, {})[key] = float(value)
        waves |= {(name, block): waveform for block, waveform in drives.items()}
        entries[name] = entry
    return entries, waves


def repaired_measurements(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> pd.DataFrame:
    """Return the measurement table with the locations of the repaired network, and without the errors of sensors.

    What the named errors of sensors change in the predictions is subtracted from the values, and its uncertainty is
    added to the standard deviations.
    """
    renamed = forward.simulation.prepared(hypothesis).renamed
    return measurement_table(forward, renamed, *_by_sensors(forward, hypothesis, fit))


def measurement_table(
    forward: Forward, renamed: dict[str, str], changes: list[np.ndarray], spreads: list[np.ndarray]
) -> pd.DataFrame:
    """Return the measurements with new names of locations, less some changes (1, k) of each series.

    spreads: the standard deviations of these changes, (1, k) each, CGS.
    """
    rows = []
    for series, change, spread in zip(forward.measured, changes, spreads, strict=True):
        quantity = series.table_quantity
        unit = WRITTEN_IN[quantity]
        location = renamed.get(series.location, series.location)
        unknown = [np.nan] * series.value.size
        known = series.time if series.pullback is None else series.pullback.time
        times, along = unknown if known is None else known, unknown
        if series.pullback is not None and series.quantity != CHECK:
            along = (series.pullback.distance / units.MM).tolist()
        corrected, sd = series.value - change[0], np.hypot(series.sd, spread[0])
        columns = (x / UNITS[quantity][unit] for x in (corrected, sd))
        for time, value, own, distance in zip(times, *columns, along, strict=True):
            key = (series.condition, quantity, location, series.statistic)
            rows.append((*key, time, value, own, unit, distance, "mm" if np.isfinite(distance) else ""))
    table = pd.DataFrame(rows, columns=[*COLUMNS, *PULLBACK_COLUMNS])
    return table if table["distance"].notna().any() else table[list(COLUMNS)]


def _by_sensors(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the change of each series (1, k) by errors of sensors, and its standard deviation, CGS."""
    errors = [placed for placed in hypothesis if placed.effect.side == "measurement"]
    if not errors:
        none = forward.split(np.zeros((1, forward.size)))
        return none, none
    columns = np.concatenate([np.arange(len(fit.z))[hypothesis.columns(fit.z, placed)] for placed in errors])
    spread = np.sqrt(np.diag(fit.posterior.moments()[1]))[columns]
    moved = np.tile(fit.z, (len(columns) + 1, 1))
    moved[np.arange(1, len(moved)), columns] += spread
    without = hypothesis.without_measurement_errors(fit.z)
    plain, read, *further = forward.predict_rows([without, *((row, hypothesis) for row in moved)])
    squares = sum(((other - read) ** 2 for other in further), start=np.zeros(len(read)))
    return forward.split((read - plain)[None, :]), forward.split(np.sqrt(squares)[None, :])


def difference(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> str:
    """List all changes: effects, added elements, recalibration factors and changed values."""
    before, after = forward.network, repaired_network(forward, hypothesis, fit.z)
    lines = [*_effect_lines(forward, hypothesis, fit), "", "Recalibration (factors)"]
    pairs = zip(forward.nuisances, fit.z, strict=False)
    lines += [f"  {one.name}: {float(one.factor(z)):.4f}" for one, z in pairs if one.shape is None]
    known = {(one.part, one.name) for one in before.elements()}
    for part in ("vessels", "junctions", "boundary_conditions"):
        added = [one.name for one in after.elements() if one.part == part and (part, one.name) not in known]
        if added:
            lines += ["", f"Added {part}: {', '.join(added)}"]
    return "\n".join([*lines, *changed_lines(before, after, forward.simulation.prepared(hypothesis).renamed)]) + "\n"


def changed_lines(before: Network, after: Network, renamed: dict[str, str]) -> list[str]:
    """List renamed locations and changed values of a network."""
    lines = []
    if renamed:
        lines += ["", "Renamed locations (old -> new); measurements.csv uses the new names"]
        lines += [f"  {old} -> {new}" for old, new in renamed.items()]
    lines += ["", "Values (old -> new)"]
    known = {(one.part, one.name): one for one in before.elements()}
    for new in after.elements():
        old = known.get((new.part, new.name))
        if old is not None and new.part in CHANGED:
            if old.kind != new.kind:
                lines.append(f"  {new.name}: {old.kind} -> {new.kind}")
            lines += value_changes(new.name, old.values, new.values)
    return lines


def _effect_lines(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> list[str]:
    pressure = next(name for name, factor in units.PRESSURES.items() if factor == forward.pressure_factor)
    lines = [f"Effects (dimensional sizes are in the units of the network: {pressure}, mL, s)"]
    for (effect, place), sizes in zip(hypothesis, hypothesis.physical_sizes(fit.z), strict=True):
        values, known = effect.physical(place, sizes, forward.anatomy), {p.name: p.meaning for p in effect.parameters}
        shown = ", ".join(f"{known.get(name, name)}: {value:.4g}" for name, value in values.items())
        lines += [f"  {effect.name} at {place}: {shown}", f"    {effect.formula}", f"    written as: {effect.native}"]
    return lines if hypothesis else [*lines, "  none"]


def value_changes(block: str, old: dict, new: dict) -> list[str]:
    """Return a line for every number or waveform of a block that is changed, added or removed."""
    lines = []
    for name, value in new.items():
        if name not in old:
            lines.append(f"  {block}.{name}: added, {_value_text(value)}")
        elif np.ndim(value) or np.ndim(old[name]):
            if np.shape(old[name]) != np.shape(value) or not np.allclose(old[name], value, rtol=SAME, atol=0.0):
                lines.append(f"  {block}.{name}: waveform replaced")
        elif old[name] != value:
            lines.append(f"  {block}.{name}: {old[name]:g} -> {value:g}")
    removed = {name: value for name, value in old.items() if name not in new}
    return lines + [f"  {block}.{name}: removed, was {_value_text(value)}" for name, value in removed.items()]


def _value_text(value: float | list) -> str:
    return "a waveform" if isinstance(value, list) else f"{value:g}"


@dataclass(frozen=True)
class Model:
    """Content of the files of a repaired or rewired model, complete before any file is written."""

    file: str
    network: Network
    measurements: pd.DataFrame
    conditions: dict[str, dict]
    drives: Drives
    difference: str

    def write(self, folder: Path) -> None:
        """Write the network, `measurements.csv`, `conditions.yaml`, `drives/` and `difference.txt`."""
        write_json(folder / self.file, self.network)
        write_csv(folder / "measurements.csv", self.measurements)
        write_conditions(folder, self.conditions, self.drives)
        write_text(folder / "difference.txt", self.difference)


def repaired(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> Model:
    """Return the repaired model of a fit with its effects."""
    return Model(
        REPAIRED,
        repaired_network(forward, hypothesis, fit.z),
        repaired_measurements(forward, hypothesis, fit),
        *repaired_conditions(forward, hypothesis, fit.z),
        difference(forward, hypothesis, fit),
    )


def rewired(forward: Forward, errors: Sequence[PlacedEffect]) -> Model:
    """Return the model without wiring errors, as it was before any recalibration, to be searched again."""
    network, lines = forward.network, ["Wiring errors corrected"]
    renamed: dict[str, str] = {}
    for error, place in errors:
        assert isinstance(error, WiringError)
        network, fresh = error.corrected(network, place)
        renamed = renamed_again(renamed, fresh)
        lines.append(f"  {error.statement(place)}")
    none = forward.split(np.zeros((1, forward.size)))
    conditions = forward.conditions.items()
    return Model(
        REWIRED,
        network,
        measurement_table(forward, renamed, none, none),
        {name: as_entry(condition) for name, condition in conditions},
        {(name, block): wave for name, condition in conditions for block, wave in condition.drive.items()},
        "\n".join([*lines, *changed_lines(forward.network, network, renamed)]) + "\n",
    )


def wiring_statement(placed: PlacedEffect) -> str:
    """State a wiring error of the model; empty for an effect."""
    error, place = placed
    return error.statement(place) if isinstance(error, WiringError) else ""
