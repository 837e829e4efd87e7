"""Samples θ = (r, s): draws of the posterior beside a scaling of total coronary resistance (paper, section 2.3)."""

from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.zerod.network.beds import SCALING

if TYPE_CHECKING:
    import pandas as pd


def theta(
    draws: "pd.DataFrame", beds: list[str], name: str, count: int, scaling: tuple[float, float], seed: int
) -> "pd.DataFrame":
    """Return a table of θ with `count` rows: `sample`, one column per bed, `R_cor_scaling`.

    Row k depends on seed, `name` of the set, k and the draws, not on `count`: a longer table begins with the shorter
    one.
    """
    rows, scalings = [], []
    for k in range(count):
        random = generator(seed, "samples", name, k)
        rows.append(int(random.integers(len(draws))))
        scalings.append(float(random.uniform(*scaling)))
    table = draws[beds].iloc[rows].reset_index(drop=True)
    table.insert(0, "sample", [f"{name}_{k:05d}" for k in range(count)])
    table[SCALING] = np.array(scalings)
    return table
