"""Pullbacks of a search as a table: readings, the model before and after, and where the named effects act."""

import numpy as np
import pandas as pd

from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.forward.pullbacks import vessels_of_readings
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.zerod.effects.measuring_chain import pullback_name
from coronaryuq.zerod.effects.pullback import CHECK, Pullback
from coronaryuq.zerod.effects.vessels_of import vessels_of

KEPT = ("condition", "quantity", "location", "statistic", "distance_mm", "measured", "sd", "recalibrated", "repaired")


def pullback_table(found: Discovery, residuals: pd.DataFrame) -> pd.DataFrame:
    """Tabulate every reading of every pullback.

    Parameters
    ----------
    found
        Answer of a search.
    residuals
        Its table of all measurements, in the order of the data.

    Returns
    -------
    DataFrame
        `KEPT` of the residuals (CGS), the vessel of each reading, whether effects are named, and those effects of the
        best hypothesis that act there; no rows without a pullback.
    """
    forward, parts = found.problem.forward, []
    for series, rows in zip(forward.measured, forward.rows, strict=True):
        if series.pullback is None or series.quantity == CHECK:
            continue
        vessels = vessels_of_readings(forward.anatomy, series.pullback)
        acting = [""] * len(vessels)
        for placed in found.hypothesis:
            within = np.full(len(vessels), placed.place == pullback_name(series))
            if placed.effect.side == "network":
                within = _within(found, placed, series.pullback, np.array(vessels))
            for number in np.flatnonzero(within).tolist():
                acting[number] += ("; " if acting[number] else "") + placed.effect.name
        named = bool(found.named)
        parts.append(residuals.iloc[rows][list(KEPT)].assign(vessel=vessels, acting=acting, named=named))
    return pd.concat(parts) if parts else pd.DataFrame(columns=[*KEPT, "vessel", "acting", "named"])


def _within(found: Discovery, placed: PlacedEffect, pullback: Pullback, vessels: np.ndarray) -> np.ndarray:
    """Return which readings lie where an effect acts: within its extent, the nearest if none does, or its vessels."""
    anatomy = found.problem.forward.anatomy
    sizes = found.hypothesis.physical_sizes(found.fit.z)[list(found.hypothesis).index(placed)]
    extent = placed.effect.extent(placed.place, sizes, anatomy)
    if extent is None:
        return np.isin(vessels, vessels_of(placed.place, anatomy))
    if placed.place not in pullback.path:
        return np.zeros(len(vessels), dtype=bool)
    ahead = sum(anatomy.length(vessel) for vessel in pullback.path[: pullback.path.index(placed.place)])
    start, end = ahead + extent[1], ahead + extent[2]
    within = (pullback.distance >= start) & (pullback.distance <= end)
    if not within.any():
        within[int(np.argmin(np.abs(pullback.distance - 0.5 * (start + end))))] = True
    return within
