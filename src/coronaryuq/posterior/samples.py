"""Samples θ = (r, s): states of the posterior's chains with a scaling of total coronary resistance (paper, 2.3)."""

from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.zerod.network.beds import SCALING

if TYPE_CHECKING:
    import pandas as pd

GOLDEN = (5**0.5 - 1) / 2


def theta(
    draws: "pd.DataFrame", beds: list[str], name: str, count: int, scaling: tuple[float, float], seed: int
) -> "pd.DataFrame":
    """Return a table of θ with `count` rows: `sample`, `chain`, `draw`, one column per bed, `R_cor_scaling`.

    Rows visit the table of draws, which is in the chains' order, in steps of the golden ratio: every stretch of the
    chains is visited equally often, however many rows there are, and no state twice before most have been visited
    once. `chain` and `draw` name the state, so that an estimate can include the error of the chains themselves.
    Row k depends on seed, `name` of the set, k and the draws, not on `count`: a longer table begins with the shorter
    one.
    """
    start = float(generator(seed, "samples", name, "start").uniform())
    rows = np.floor(len(draws) * ((start + GOLDEN * np.arange(count)) % 1.0)).astype(int)
    visited = draws.iloc[rows].reset_index(drop=True)
    table = visited[beds].copy()
    table.insert(0, "sample", [f"{name}_{k:05d}" for k in range(count)])
    table.insert(1, "chain", visited["chain"])
    table.insert(2, "draw", visited["generation"])
    table[SCALING] = [float(generator(seed, "samples", name, k).uniform(*scaling)) for k in range(count)]
    return table
