"""Values of a network by name, and differences between two networks of one structure."""

from typing import Any

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.network.numbering import PERIOD
from coronaryuq.zerod.network.period import period_of
from coronaryuq.zerod.network.waveforms import WAVEFORMS, sampled

LOSS = "stenosis_coefficient"
ELEMENTS = ("R_poiseuille", "L", "C", LOSS)
"""Values of a vessel; zero if the file omits them."""


def is_number(value: object) -> bool:
    """Whether a value of a network is a number rather than a waveform or a flag."""
    return isinstance(value, int | float) and not isinstance(value, bool)


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
