"""Fit the resistances of a 0D network so that its beds share the flow as a table of target flows says."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.posterior.model.bed_flows import BedFlows, with_resistances
from coronaryuq.posterior.model.fit_to_fractions import fit_fractions
from coronaryuq.zerod.network.beds import Bed, beds

if TYPE_CHECKING:
    import pandas as pd

FORMS = (("flow",), ("mbf", "volume"), ("volume",))
"""Columns to whose product the flows are proportional; the first set that the table has is used."""


def fit_table(
    network: Network, network_json: str | Path, flows_csv: str | Path, hyperaemia: float = 1.0
) -> tuple["pd.DataFrame", Network]:
    """Return the fit, one row per bed of `flows_csv`, and the network with the fitted resistances.

    Resistances are Ra + Ram + Rv in the network's unit; `first_*` is before the fit, `fitted_*` after; errors are
    relative to the target fraction.

    Parameters
    ----------
    network, network_json
        The network, in the state of the flows, and the file that it was read from.
    flows_csv
        Table with `name` and the columns of one of `FORMS`.
    hyperaemia
        Factor on Ra and Ram of every bed before the fit.

    Raises
    ------
    InputError
        If a name is not a coronary bed, or if a number is not positive.
    """
    import pandas as pd

    if not hyperaemia > 0:
        raise InputError("--hyperaemia", None, hyperaemia, "expected a positive factor")
    network = with_resistances(network, network_json, hyperaemia=hyperaemia)
    names, wanted = _proportions(flows_csv, beds(network))
    vessels = {name: _vessel_of(network, name, network_json) for name in names}
    model = BedFlows(network_json, vessels, tolerance=1e-4, steps_per_cycle=None, network=network)
    fit = fit_fractions(model.flows, model.weights, wanted)
    first, fitted = (flows / flows.sum() for flows in (fit.flows_at_r_hat, fit.flows))
    table = pd.DataFrame(
        {
            "bc": names,
            "target_fraction": wanted,
            "first_resistance": model.resistances,
            "first_fraction": first,
            "first_error": first / wanted - 1.0,
            "fitted_multiplier": fit.multipliers,
            "fitted_resistance": fit.multipliers * model.resistances,
            "fitted_flow": fit.flows,
            "fitted_fraction": fitted,
            "fitted_error": fitted / wanted - 1.0,
        }
    )
    fitted_network = with_resistances(network, network_json, dict(zip(names, fit.multipliers, strict=True)))
    return table, fitted_network


def _proportions(path: str | Path, known: Mapping[str, Bed]) -> tuple[list[str], np.ndarray]:
    frame = read_csv(path, ("name",))
    columns = next((form for form in FORMS if set(form) <= set(frame.columns)), None)
    if columns is None:
        raise InputError(path, "flow", None, "column missing; expected flow, or mbf and volume, or volume")
    names = []
    for cell in (str(cell).strip() for cell in frame["name"]):
        name = cell if cell in known else f"BC_{cell}"
        if name not in known:
            raise InputError(path, "name", cell, f"not a coronary bed; there are {', '.join(known) or 'none'}")
        if name in names:
            raise InputError(path, "name", cell, "duplicate")
        names.append(name)
    if len(names) < 2:
        raise InputError(path, "rows", len(names), "at least two beds are required")
    product = np.ones(len(names))
    for column in columns:
        values = _numbers(frame[column])
        for name, value in zip(names, values, strict=True):
            if not (np.isfinite(value) and value > 0):
                raise InputError(path, f"{column} of {name}", float(value), "must be a positive number")
        product = product * values
    return names, product / product.sum()


def _numbers(column: "pd.Series") -> np.ndarray:
    import pandas as pd

    return pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)


def _vessel_of(network: Network, bed: str, path: str | Path) -> str:
    vessels = Topology(network).vessel_of
    if bed not in vessels:
        raise InputError(path, bed, None, "no vessel ends in this bed")
    return vessels[bed]
