"""Values of a network by name, and differences between two networks of one structure."""

from typing import Any

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.data.apply_condition import ELEMENTS, WAVEFORMS, is_number
from coronaryuq.zerod.effects.base import sampled
from coronaryuq.zerod.network.numbering import PERIOD
from coronaryuq.zerod.network.period import period_of


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
