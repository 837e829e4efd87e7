"""Mean pressure along every vessel of the tree at one θ, for figures: the reading of a pressure wire."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.anatomy.tree import placed_stenoses, read_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.build import segments
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import Theta


def write_map(
    network_json: str | Path, case_json: str | Path, tree_vtp: str | Path, draws_csv: str | Path, out_csv: str | Path
) -> None:
    """Run the loop at the posterior mean, with s = 1, and write the mean pressure along the tree.

    Columns: vessel (of the tree), position (0 at its start, 1 at its end), pressure (dyn/cm2), ffr (mean pressure over
    mean aortic pressure), flow (mL/s). One row per end of every 0D segment.
    """
    network, case, tree = (
        read_network(network_json),
        read_case(case_json),
        read_tree(tree_vtp),
    )
    draws = read_csv(draws_csv)
    inputs = Theta(network, network_json)
    theta = {name: np.array([draws[name].mean()]) for name in inputs.columns if name in draws.columns}
    parts = segments(tree, placed_stenoses(case.stenoses))
    engine = Engine(network)
    ends = _ends(engine.unknowns)
    aorta = f"mean_pressure:{case.aorta.pressure}"
    wanted = {place for part in parts for place in ends.get(part.name, ())}
    quantities = [f"mean_{kind}:{place}" for place in sorted(wanted) for kind in ("pressure", "flow")]
    result = engine.run_cycles(inputs.changes(theta), [aorta, *quantities])
    value = {name: float(values[0]) for name, values in result.values.items()}
    rows = []
    for part in parts:
        for place, arc in zip(ends.get(part.name, ()), (part.start, part.end), strict=False):
            pressure = value[f"mean_pressure:{place}"]
            rows.append(
                {
                    "vessel": part.vessel,
                    "position": arc / tree[part.vessel].length,
                    "pressure": pressure,
                    "ffr": pressure / value[aorta],
                    "flow": value[f"mean_flow:{place}"],
                }
            )
    write_csv(out_csv, pd.DataFrame(rows))


def _ends(unknowns: list[str]) -> dict[str, tuple[str, str]]:
    """Return the upstream and downstream connection of every block that has both."""
    places = [name.removeprefix("pressure:") for name in unknowns if name.startswith("pressure:")]
    upstream = {place.split(":")[1]: place for place in places}
    downstream = {place.split(":")[0]: place for place in places}
    return {block: (upstream[block], downstream[block]) for block in upstream if block in downstream}
