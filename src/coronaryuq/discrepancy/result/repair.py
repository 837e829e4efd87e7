"""The repaired model: network and conditions with the named effects written in, the measurements under the names that
its locations have, and a diff that a person can read.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from coronaryuq.case.network.network import HEART, Network
from coronaryuq.core import units
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.discrepancy.data.conditions import Condition, as_entry, drive_files, under, write_drive
from coronaryuq.discrepancy.data.measurements import COLUMNS, UNITS
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.forward.network_values import scalars, with_values
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.gauss_newton import Fit

SAME = 1e-9
WRITTEN_IN = {"flow": "mL/s", "pressure": "mmHg", "volume": "mL", "perfusion": "mL/min/g", "ratio": "1"}
"""Unit of each measured quantity in the table beside a repaired network."""


def repaired_network(forward: Forward, hypothesis: Hypothesis, z: np.ndarray) -> dict:
    """The network at rest with the elements and values of the effects, recalibrated to z (p,)."""
    plain = Condition("the network as it is")
    alone = replace(
        forward, simulation=forward.simulation.changed(conditions={plain.name: plain}), measured=[], shapes=None
    )
    table, structure = alone.condition_changes(plain.name, z, hypothesis)
    return with_values(structure, table)


def repaired_conditions(
    forward: Forward, hypothesis: Hypothesis, z: np.ndarray
) -> tuple[dict[str, dict], dict[str, tuple[np.ndarray, np.ndarray]]]:
    """Content of the conditions file that goes with the repaired network, and its drives: file → times and values.

    What an effect or the recalibration changes under one condition only is written as `set`, a waveform as a drive,
    so that the repaired network under the new conditions is what was fitted.
    """
    network = repaired_network(forward, hypothesis, z)
    content, waves = {}, {}
    for name, condition in forward.conditions.items():
        entry = as_entry(condition)
        wanted, _ = forward.condition_changes(name, z, hypothesis)
        given = scalars(under(network, condition))
        drives = dict(condition.drive)
        for parameter, value in wanted.items():
            block, _, key = parameter.rpartition(".")
            if np.ndim(value):
                drives[block] = np.linspace(0.0, forward.periods[name], len(value)), np.asarray(value)
            elif abs(given.get(parameter, 0.0) - float(value)) > SAME * abs(float(value)):
                entry.setdefault("set", {}).setdefault(block, {})[key] = float(value)
        waves |= {(name, block): waveform for block, waveform in drives.items()}
        content[name] = entry
    at = drive_files(waves)
    for name, block in waves:
        content[name].setdefault("drive", {})[block] = at[name, block]
    return content, {at[which]: waveform for which, waveform in waves.items()}


def renamed_locations(forward: Forward, hypothesis: Hypothesis) -> dict[str, str]:
    """Old name → new name of the locations that the repaired network calls otherwise."""
    return forward.simulation.prepared(forward.simulation.inserting(hypothesis)).renamed


def repaired_measurements(forward: Forward, hypothesis: Hypothesis) -> pd.DataFrame:
    """The table of measurements with the repaired network's names, to examine that network with; numbers stay."""
    renamed, rows = renamed_locations(forward, hypothesis), []
    for one in forward.measured:
        unit = WRITTEN_IN[one.quantity]
        key = (one.condition, one.quantity, renamed.get(one.location, one.location), one.statistic)
        times = [np.nan] * one.value.size if one.time is None else one.time
        for time, value, sd in zip(times, *(x / UNITS[one.quantity][unit] for x in (one.value, one.sd)), strict=True):
            rows.append((*key, time, value, sd, unit))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def difference(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> str:
    """What changed, in words and numbers: the effects, the elements added, recalibration factors, every value."""
    pressure = next(name for name, factor in units.PRESSURES.items() if factor == forward.pressure_factor)
    lines = [f"Effects (sizes that have a unit are in the network's: {pressure}, mL, s)"]
    for (effect, place), sizes in zip(hypothesis, hypothesis.physical_sizes(fit.z), strict=True):
        shown = ", ".join(f"{k} {v:.4g}" for k, v in effect.physical(place, sizes, forward.anatomy).items())
        lines += [f"  {effect.name} at {place}: {shown}", f"    {effect.formula}", f"    written as: {effect.native}"]
    if not hypothesis:
        lines.append("  none")
    before, after = forward.network, repaired_network(forward, hypothesis, fit.z)
    lines += ["", "Recalibration (factors)"]
    for nuisance, z in ((n, z) for n, z in zip(forward.nuisances, fit.z, strict=False) if n.shape is None):
        lines.append(f"  {nuisance.name}: {float(nuisance.factor(z)):.4f}")
    for part, key in (("vessels", "vessel_name"), ("junctions", "junction_name"), ("boundary_conditions", "bc_name")):
        old = {entry[key] for entry in before.get(part, [])}
        added = [entry[key] for entry in after.get(part, []) if entry[key] not in old]
        if added:
            lines += ["", f"Added {part}: {', '.join(added)}"]
    renamed = renamed_locations(forward, hypothesis)
    if renamed:
        lines += ["", "Renamed locations (old -> new); measurements.csv has the new names"]
        lines += [f"  {old} -> {new}" for old, new in renamed.items()]
    lines += ["", "Values (old -> new)"]
    for part, key, values, kind in (
        ("vessels", "vessel_name", "zero_d_element_values", "zero_d_element_type"),
        ("boundary_conditions", "bc_name", "bc_values", "bc_type"),
    ):
        old = {entry[key]: entry for entry in before.get(part, [])}
        for entry in after.get(part, []):
            if entry[key] in old:
                name, was = entry[key], old[entry[key]]
                if was.get(kind) != entry.get(kind):
                    lines.append(f"  {name}: {was.get(kind)} -> {entry.get(kind)}")
                lines += _changed(name, was[values], entry[values])
    for old, new in zip(before.get("closed_loop_blocks", []), after.get("closed_loop_blocks", []), strict=True):
        lines += _changed(HEART, old["parameters"], new["parameters"])
    return "\n".join(lines) + "\n"


def _changed(block: str, old: dict, new: dict) -> list[str]:
    """A line for every number or waveform of a block that differs, is added, or is no longer there."""
    lines = []
    for name, value in new.items():
        if name not in old:
            lines.append(f"  {block}.{name}: added, {_told(value)}")
        elif np.ndim(value) or np.ndim(old[name]):
            if np.shape(old[name]) != np.shape(value) or not np.allclose(old[name], value, rtol=SAME, atol=0.0):
                lines.append(f"  {block}.{name}: waveform replaced")
        elif old[name] != value:
            lines.append(f"  {block}.{name}: {old[name]:g} -> {value:g}")
    gone = [f"  {block}.{name}: removed, was {_told(value)}" for name, value in old.items() if name not in new]
    return lines + gone


def _told(value: float | list) -> str:
    return "a waveform" if np.ndim(value) else f"{value:g}"


@dataclass(frozen=True)
class Repaired:
    """What is written of a repaired model, made whole before any of it is: what cannot be made leaves nothing."""

    network: Network
    measurements: pd.DataFrame
    conditions: dict[str, dict]
    drives: dict[str, tuple[np.ndarray, np.ndarray]]
    difference: str

    def write(self, folder: Path) -> None:
        """`repaired.json`, `measurements.csv`, `conditions.yaml`, `drives/` and `difference.txt` into `folder`."""
        write_json(folder / "repaired.json", self.network)
        write_csv(folder / "measurements.csv", self.measurements)
        for name, waveform in self.drives.items():
            write_drive(folder / name, *waveform)
        write_text(folder / "conditions.yaml", yaml.safe_dump(self.conditions, sort_keys=False))
        write_text(folder / "difference.txt", self.difference)


def repaired(forward: Forward, hypothesis: Hypothesis, fit: Fit) -> Repaired:
    """The repaired model of a fit with its effects."""
    return Repaired(
        repaired_network(forward, hypothesis, fit.z),
        repaired_measurements(forward, hypothesis),
        *repaired_conditions(forward, hypothesis, fit.z),
        difference(forward, hypothesis, fit),
    )
