"""Samples θ: states of the posterior's chains with a scaling of total coronary resistance (paper, 2.3)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.zerod.network.beds import SCALING

if TYPE_CHECKING:
    import pandas as pd

GOLDEN = (5**0.5 - 1) / 2


Lengths = Sequence[tuple[int, int]]
"""First sample and length of the chains that it and later ones are drawn from, by sample; lengths: see `Chains`."""
FIRST: Lengths = ((0, 1),)


def theta(
    draws: "pd.DataFrame", columns: list[str], name: str, count: int, scaling: tuple[float, float], seed: int,
    lengths: Lengths = FIRST,
) -> "pd.DataFrame":  # fmt: skip
    """Return a table of θ with `count` rows: `sample`, `chain`, `draw`, `columns`, `R_cor_scaling`.

    Rows visit the table of draws, which is in the chains' order, in steps of the golden ratio: every stretch of the
    chains is visited equally often, however many rows there are, and no state twice before most have been visited
    once. Of chains that were made longer, each sample visits the part with the fewest visits until then, so that
    samples spread over the new parts first and then over all. `chain` and `draw` name the state, so that an estimate
    can include the error of the chains themselves.
    Row k depends on seed, `name` of the set, k, the length of the chains at sample k and their draws, not on `count`: a
    longer table begins with the shorter one.

    Parameters
    ----------
    draws
        Of chains of the last of `lengths`.
    columns
        Those of multipliers and of uncertain parameters.
    name, count
        Of the set, and its number of samples.
    scaling, seed
        Bounds of the scaling where the draws have none of their own, and the campaign's seed.
    lengths
        From which sample on the chains had which length.
    """
    part, visit = _visits(lengths, count)
    size = len(draws) // lengths[-1][1]
    start = np.array([_start(seed, name, k) for k in range(lengths[-1][1])])
    rows = part * size + np.floor(size * ((start[part] + GOLDEN * visit) % 1.0)).astype(int)
    visited = draws.iloc[rows].reset_index(drop=True)
    table = visited[columns].copy()
    table.insert(0, "sample", [f"{name}_{k:05d}" for k in range(count)])
    table.insert(1, "chain", visited["chain"])
    table.insert(2, "draw", visited["generation"])
    if SCALING in draws:
        table[SCALING] = visited[SCALING]
    else:
        table[SCALING] = [float(generator(seed, "samples", name, k).uniform(*scaling)) for k in range(count)]
    return table


def _start(seed: int, name: str, part: int) -> float:
    return float(generator(seed, "samples", name, "start", *([part] if part else [])).uniform())


def _visits(lengths: Lengths, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the part of the chains that each sample visits, and how many samples visited it before."""
    part, visit = np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    visits = np.zeros(lengths[-1][1], dtype=int)
    ends = [first for first, _ in lengths[1:]] + [count]
    for (first, length), end in zip(lengths, ends, strict=True):
        for k in range(first, min(end, count)):
            part[k] = np.argmin(visits[:length])
            visit[k] = visits[part[k]]
            visits[part[k]] += 1
    return part, visit
