"""Mean pressure and flow along every vessel of the tree, over the posterior: the readings of a pressure wire."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.anatomy.tree import placed_stenoses, read_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.records import OK
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.predicted import TreePressures, predictions
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import read_theta, theta_changes

STATES = 200
"""Samples of the posterior that are run."""
SHARES = {"_low": 0.05, "": 0.5, "_high": 0.95}
"""Quantiles by the ending of their columns."""


def write_map(
    network_json: str | Path, case_json: str | Path, tree_vtp: str | Path, samples_csv: str | Path,
    out_csv: str | Path, predicted_csv: str | Path,
) -> None:  # fmt: skip
    """Run a table of θ and write quantiles of pressure and flow along the tree, and of what `predictions` returns.

    Columns: vessel (of the tree), position (0 at its start, 1 at its end), then median, 5 and 95 % quantiles (endings
    `_low`, `_high`) of pressure (mean, dyn/cm2), ffr (mean pressure over mean aortic pressure) and flow (mean, mL/s).
    One row per end of every 0D segment.
    """
    network, case, tree = read_network(network_json), read_case(case_json), read_tree(tree_vtp)
    theta = read_theta(samples_csv, 0, len(read_csv(samples_csv)), network, network_json)
    inputs = {name: theta[name].to_numpy() for name in theta.columns if name != "sample"}
    parts = vessels_along(tree, placed_stenoses(case.stenoses), network, str(network_json))
    engine = Engine(network)
    ends = _ends(engine.unknowns)
    aorta = f"mean_pressure:{case.aorta.pressure}"
    blocks = list(dict.fromkeys([part.name for part in parts] + [s.segment for s in case.stenoses]))
    wanted = {place for block in blocks for place in ends.get(block, ())}
    quantities = [f"mean_{kind}:{place}" for place in sorted(wanted) for kind in ("pressure", "flow")]
    result = engine.run_cycles(theta_changes(network, inputs), [aorta, *quantities])
    ok = result.status == OK
    if not ok.any():
        raise InputError(samples_csv, None, None, f"no 0D run of its {len(ok)} samples succeeded")
    value = {name: values[ok] for name, values in result.values.items()}
    rows = []
    for part in parts:
        for place, arc in zip(ends.get(part.name, ()), (part.start, part.end), strict=False):
            pressure, flow = value[f"mean_pressure:{place}"], value[f"mean_flow:{place}"]
            readings = {"pressure": pressure, "ffr": pressure / value[aorta], "flow": flow}
            row = {"vessel": part.vessel, "position": arc / tree[part.vessel].length}
            for name, values in readings.items():
                row |= {f"{name}{ending}": np.quantile(values, share) for ending, share in SHARES.items()}
            rows.append(row)
    pressures = {
        block: (value[f"mean_pressure:{ends[block][0]}"], value[f"mean_pressure:{ends[block][1]}"])
        for block in blocks
        if block in ends
    }
    write_csv(predicted_csv, predictions(case, TreePressures(tree, parts, pressures, value[aorta])))
    write_csv(out_csv, pd.DataFrame(rows))


def _ends(unknowns: list[str]) -> dict[str, tuple[str, str]]:
    """Return the upstream and downstream connection of every block that has both."""
    places = [name.removeprefix("pressure:") for name in unknowns if name.startswith("pressure:")]
    upstream = {place.split(":")[1]: place for place in places}
    downstream = {place.split(":")[0]: place for place in places}
    return {block: (upstream[block], downstream[block]) for block in upstream if block in downstream}
