"""The repaired model: network and conditions with the named effects written in, and a diff that a person can read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from coronaryuq import files
from coronaryuq.discrepancy.conditions import HEART, Condition, as_entry, drive_file, under, write_drive
from coronaryuq.discrepancy.forward import Forward
from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.networks import scalars, with_values
from coronaryuq.discrepancy.simulation import Acting

SAME = 1e-9


def repaired_network(forward: Forward, acting: list[Acting], z: np.ndarray) -> dict:
    """The network at rest with the elements and values of the acting effects, recalibrated to z (p,)."""
    plain = Condition("the network as it is")
    alone = replace(
        forward, simulation=forward.simulation.changed(conditions={plain.name: plain}), measured=[], shapes=None
    )
    table, structure = alone.condition_changes(plain.name, z, acting)
    return with_values(structure, table)


def repaired_conditions(forward: Forward, acting: list[Acting], z: np.ndarray, folder: Path) -> dict[str, dict]:
    """Content of the conditions file that goes with the repaired network.

    What an effect or the recalibration changes under one condition only is written as `set`, a waveform as a drive,
    so that the repaired network under the new conditions is what was fitted.
    """
    network = repaired_network(forward, acting, z)
    content = {}
    for name, condition in forward.conditions.items():
        entry = as_entry(condition)
        wanted, _ = forward.condition_changes(name, z, acting)
        given = scalars(under(network, condition))
        drives = {bc: drive_file(name, bc) for bc in condition.drive}
        for bc, (time, value) in condition.drive.items():
            write_drive(folder / drives[bc], time, value)
        for parameter, value in wanted.items():
            block, _, key = parameter.rpartition(".")
            if np.ndim(value):
                drives[block] = drive_file(name, block)
                time = np.linspace(0.0, forward.periods[name], len(value))
                write_drive(folder / drives[block], time, np.asarray(value))
            elif abs(given.get(parameter, 0.0) - float(value)) > SAME * abs(float(value)):
                entry.setdefault("set", {}).setdefault(block, {})[key] = float(value)
        if drives:
            entry["drive"] = drives
        content[name] = entry
    return content


def difference(forward: Forward, acting: list[Acting], fit: Fit) -> str:
    """What changed, in words and numbers: the effects, the elements added, recalibration factors, every value."""
    lines = ["Effects"]
    column = len(forward.nuisances)
    for effect, place in acting:
        sizes = {p.name: float(p.from_standard(fit.z[column + i])) for i, p in enumerate(effect.parameters)}
        column += len(effect.parameters)
        shown = ", ".join(f"{k} {v:.4g}" for k, v in effect.physical(place, sizes, forward.anatomy).items())
        lines += [f"  {effect.name} at {place}: {shown}", f"    {effect.formula}", f"    written as: {effect.native}"]
    if not acting:
        lines.append("  none")
    before, after = forward.network, repaired_network(forward, acting, fit.z)
    lines += ["", "Recalibration (factors)"]
    for nuisance, z in ((n, z) for n, z in zip(forward.nuisances, fit.z, strict=False) if n.shape is None):
        lines.append(f"  {nuisance.name}: {float(nuisance.factor(z)):.4f}")
    for part, key in (("vessels", "vessel_name"), ("junctions", "junction_name"), ("boundary_conditions", "bc_name")):
        old = {entry[key] for entry in before.get(part, [])}
        added = [entry[key] for entry in after.get(part, []) if entry[key] not in old]
        if added:
            lines += ["", f"Added {part}: {', '.join(added)}"]
    lines += ["", "Values (old -> new)"]
    for part, key, values in (
        ("vessels", "vessel_name", "zero_d_element_values"),
        ("boundary_conditions", "bc_name", "bc_values"),
    ):
        old = {entry[key]: entry[values] for entry in before.get(part, [])}
        for entry in after.get(part, []):
            for name, value in entry[values].items():
                was = old.get(entry[key], {}).get(name)
                if isinstance(value, list):
                    if was is not None and (len(was) != len(value) or not np.allclose(was, value, rtol=SAME, atol=0.0)):
                        lines.append(f"  {entry[key]}.{name}: waveform replaced")
                elif entry[key] in old and was != value:
                    lines.append(f"  {entry[key]}.{name}: {was if was is not None else 0.0:g} -> {value:g}")
    for old, new in zip(before.get("closed_loop_blocks", []), after.get("closed_loop_blocks", []), strict=True):
        for name, value in new["parameters"].items():
            was = old["parameters"].get(name, 0.0)
            if was != value:
                lines.append(f"  {HEART}.{name}: {was:g} -> {value:g}")
    return "\n".join(lines) + "\n"


def write_repaired(forward: Forward, acting: list[Acting], fit: Fit, folder: Path) -> None:
    """Write `repaired.json`, `conditions.yaml`, `drives/` and `difference.txt` into `folder`."""
    files.write_json(folder / "repaired.json", repaired_network(forward, acting, fit.z))
    content = repaired_conditions(forward, acting, fit.z, folder)
    files.write_text(folder / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
    files.write_text(folder / "difference.txt", difference(forward, acting, fit))
