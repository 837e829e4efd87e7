"""Solve one 0D network in time, from Python."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coronaryuq.zerod.network.read import check_network, read_network
from coronaryuq.zerod.svzerodsolver.tables import simulate

if TYPE_CHECKING:
    import pandas as pd


def solve(network: str | Path | Mapping[str, Any]) -> "pd.DataFrame":
    """Solve a 0D network in time with its `simulation_parameters`, as `coronaryuq solve` does.

    Parameters
    ----------
    network
        svZeroDSolver JSON: its path or its content.

    Returns
    -------
    pandas.DataFrame
        svZeroDSolver's table: `name`, `time` (s) and flows and pressures of every vessel, or `y` of every variable if
        the network has `output_variable_based`. Flows and pressures are in the network's units: mL/s and dyn/cm2 in
        those that coronaryuq writes.

    Raises
    ------
    InputError
        If the network is wrong; names block, key and value.
    RuntimeError
        If Newton's method does not converge.
    """
    if isinstance(network, Mapping):
        return simulate(check_network(dict(network), "network"), "network")
    return simulate(read_network(network), str(network))
