"""Values of a network by name, and differences between two networks of one structure."""

from typing import Any

import numpy as np

from coronaryuq.case.network.network import HEART, Network
from coronaryuq.discrepancy.data.apply_condition import ELEMENTS, WAVEFORMS, is_number, period_of
from coronaryuq.zerod.effects.base import sampled
from coronaryuq.zerod.network.numbering import PERIOD


def scalars(network: Network) -> dict[str, float]:
    """Return "BLOCK.parameter" → number of every vessel, boundary condition and heart."""
    found: dict[str, Any] = {}
    for part, block, _, values in network.elements():
        defaults = dict.fromkeys(ELEMENTS, 0.0) if part == "vessels" else {}
        found |= {f"{block}.{name}": value for name, value in (defaults | values).items()}
    return {name: float(value) for name, value in found.items() if is_number(value)}


def differences(own: Network, other: Network) -> dict[str, float | np.ndarray]:
    """Return the solver parameters that turn `own` into `other` of the same structure; waveforms (WAVE_POINTS,)."""
    ours, theirs = scalars(own), scalars(other)
    found: dict[str, float | np.ndarray] = {name: value for name, value in theirs.items() if ours[name] != value}
    if period_of(own) != period_of(other):
        found[PERIOD] = period_of(other)
    for block in own["boundary_conditions"]:
        if block["bc_type"] in WAVEFORMS:
            name = f"{block['bc_name']}.{WAVEFORMS[block['bc_type']]}"
            before, after = sampled(own, name), sampled(other, name)
            if np.abs(before - after).max() > 1e-9 * np.abs(before).max():
                found[name] = after
    return found


def inner_unknowns(unknowns: list[str]) -> list[str]:
    """Return the unknowns inside the heart and beds, which are not a flow or pressure between blocks."""
    return [name for name in unknowns if not name.startswith(("flow:", "pressure:"))]


def with_values(network: Network, table: dict) -> Network:
    """Return the network with new values, "BLOCK.parameter" → number or waveform on an even grid over the cycle.

    Blocks without changes are shared with `network`.
    """
    changed: dict[str, dict] = {}
    for name, value in table.items():
        block, _, parameter = name.rpartition(".")
        changed.setdefault(block, {})[parameter] = value
    found = Network(network)
    for part, key, values in (
        ("vessels", "vessel_name", "zero_d_element_values"),
        ("boundary_conditions", "bc_name", "bc_values"),
    ):
        found[part] = [
            entry | {values: _with(entry[values], changed[entry[key]], network)} if entry[key] in changed else entry
            for entry in network[part]
        ]
    if HEART in changed:
        heart, *others = network["closed_loop_blocks"]
        parameters = _with(heart["parameters"], changed[HEART], network)
        found["closed_loop_blocks"] = [heart | {"parameters": parameters}, *others]
    return found


def _with(values: dict, changed: dict, network: Network) -> dict:
    found = dict(values)
    for parameter, value in changed.items():
        if np.ndim(value) == 0:
            found[parameter] = float(value)
            continue
        found[parameter] = np.asarray(value, dtype=float).tolist()
        if len(found["t"]) != len(value) or not np.allclose(np.diff(found["t"], n=2), 0.0):
            found["t"] = np.linspace(0.0, period_of(network), len(value)).tolist()
    return found
