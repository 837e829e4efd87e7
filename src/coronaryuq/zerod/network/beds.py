"""Coronary beds of a network, and how r, s and hyperaemia change their resistances."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError

SCALING = "R_cor_scaling"
"""Name of s in tables of θ."""

HYPERAEMIA = 0.24
"""Ra and Ram at hyperaemia over rest (paper, section 2.4; Wilson et al. 1990)."""


@dataclass(frozen=True)
class Bed:
    """A coronary boundary condition: the names of its arterial, myocardial and venous resistances."""

    name: str
    arterial: str
    myocardial: tuple[str, ...]
    venous: str

    @property
    def resistances(self) -> tuple[str, ...]:
        return (self.arterial, *self.myocardial, self.venous)


_NAMES = {
    "ClosedLoopCoronaryLeft": ("Ra", ("Ram",), "Rv"),
    "ClosedLoopCoronaryRight": ("Ra", ("Ram",), "Rv"),
    "CORONARY": ("Ra1", ("Ra2",), "Rv1"),
    "CORONARY_VAR_RES": ("Ra1", ("Ra2_min", "Ra2_max"), "Rv1"),
}


def beds(network: Network) -> dict[str, Bed]:
    """Return the coronary beds by the name of their boundary condition, in the network's order."""
    return {
        block["bc_name"]: Bed(block["bc_name"], *_NAMES[block["bc_type"]])
        for block in network.boundary_conditions
        if block["bc_type"] in _NAMES
    }


def distal_resistances(network: Network) -> dict[str, float]:
    """Return Ra + Ram + Rv of each bed, in the network's unit; a varying Ram counts with its minimum."""
    totals = {}
    for name, bed in beds(network).items():
        values = network.bed_values(name)
        totals[name] = float(values[bed.arterial] + values[bed.myocardial[0]] + values[bed.venous])
    return totals


def resistance_changes(
    network: Network,
    multipliers: Mapping[str, np.ndarray | float] | None = None,
    scaling: np.ndarray | float = 1.0,
    hyperaemia: np.ndarray | float = 1.0,
) -> dict[str, np.ndarray]:
    """Return changes for `Engine.run_cycles` that scale the coronary resistances.

    Parameters
    ----------
    network : Network
        A checked network.
    multipliers : mapping of str to float or array (n,), optional
        Bed → r, a factor on Ra, Ram and Rv of that bed; 1 for beds that are not named.
    scaling : float or array (n,)
        s, a factor on Ra, Ram and Rv of every bed.
    hyperaemia : float or array (n,)
        A factor on Ra and Ram of every bed.

    Returns
    -------
    dict of str to array (n,) or 0-d
        "BED.parameter" → resistance, in the network's unit.

    Raises
    ------
    InputError
        If a bed is not in the network, or if a factor is not positive.
    """
    coronary, multipliers = beds(network), multipliers or {}
    for name in multipliers:
        if name not in coronary:
            remedy = f"not a coronary bed; the network has {', '.join(coronary) or 'none'}"
            raise InputError("network", name, None, remedy)
    for name, factor in {**multipliers, SCALING: scaling, "hyperaemia": hyperaemia}.items():
        if not np.all(np.asarray(factor, float) > 0.0):
            raise InputError("network", name, "not positive", "expected positive factors")
    changes = {}
    for name, bed in coronary.items():
        total = np.asarray(multipliers.get(name, 1.0), float) * np.asarray(scaling, float)
        for key in bed.resistances:
            factor = total if key == bed.venous else total * np.asarray(hyperaemia, float)
            changes[f"{name}.{key}"] = network.bed_values(name)[key] * factor
    return changes
