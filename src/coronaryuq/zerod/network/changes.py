"""Changes written into a network: the same "BLOCK.parameter" names that `Engine.run` takes, one sample's numbers."""

from collections.abc import Mapping
from pathlib import Path

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import PERIOD
from coronaryuq.zerod.network.read import HEART, Network, copy_of


def with_changes(network: Network, changes: Mapping[str, float], file: str | Path = "network") -> Network:
    """A copy of the network with scalar `changes` written into it; `InputError` for a name that it lacks.

    A changed period stretches the waveforms with it.
    """
    changed = copy_of(network)
    values = _values(changed)
    for name, value in changes.items():
        if name == PERIOD:
            _set_period(changed, float(value))
            continue
        block, _, parameter = name.rpartition(".")
        parameter, _, place = parameter.partition("[")
        if block not in values:
            raise InputError(file, name, None, "no block of the network has this name")
        if place:
            values[block][parameter][int(place.rstrip("]"))] = float(value)
        else:
            values[block][parameter] = float(value)
    return changed


def _values(network: Network) -> dict[str, dict]:
    found = {vessel["vessel_name"]: vessel["zero_d_element_values"] for vessel in network.get("vessels", [])}
    found |= {block["bc_name"]: block["bc_values"] for block in network["boundary_conditions"]}
    found |= {block["name"]: block["values"] for block in network.get("external_solver_coupling_blocks", [])}
    found |= {block["junction_name"]: block.get("junction_values", {}) for block in network.get("junctions", [])}
    for block in network.get("closed_loop_blocks", []):
        found[HEART] = block["parameters"]
    return found


def _set_period(network: Network, period: float) -> None:
    for block in network.get("closed_loop_blocks", []):
        block["cardiac_cycle_period"] = period
    for values in _values(network).values():
        times = values.get("t", [])
        if len(times) > 1:
            stretch = period / (times[-1] - times[0])
            values["t"] = [times[0] * stretch, *(time * stretch for time in times[1:-1]), times[0] * stretch + period]
    if network["simulation_parameters"].get("cardiac_period", -1.0) >= 0 or not network.get("closed_loop_blocks"):
        network["simulation_parameters"]["cardiac_period"] = period
