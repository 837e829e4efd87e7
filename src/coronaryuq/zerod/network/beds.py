"""Coronary beds of a network, and how θ = (r, s) and hyperaemia change their resistances."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.records import STATE

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


def theta_changes(network: Network, theta: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Call `resistance_changes` for columns of a table of θ: one per bed, and `R_cor_scaling` (1 if absent)."""
    multipliers = {name: value for name, value in theta.items() if name != SCALING}
    return resistance_changes(network, multipliers, theta.get(SCALING, 1.0))


def read_theta(
    samples_csv: str | Path, first: int, count: int, network: Network, file: str | Path = "network"
) -> pd.DataFrame:
    """Read rows `first` to `first + count` of a table of θ.

    Parameters
    ----------
    samples_csv
        CSV with `sample`, one column per coronary bed, and `R_cor_scaling`; columns `chain` and `draw` are dropped.
    first, count
        Rows to read, from 0.
    network, file
        The network whose beds the columns name, and its file.

    Returns
    -------
    pandas.DataFrame
        The `count` rows.

    Raises
    ------
    InputError
        The table is too short, or a column is not a coronary bed of the network.
    """
    table = read_csv(samples_csv, ("sample",)).drop(columns=list(STATE), errors="ignore")
    theta = table.iloc[first : first + count]
    if len(theta) < count:
        raise InputError(samples_csv, "sample", len(table), f"expected at least {first + count} rows")
    known = {*beds(network), SCALING, "sample"}
    for column in theta.columns:
        if column not in known:
            raise InputError(samples_csv, column, None, f"not a coronary bed of {file}")
    return theta
