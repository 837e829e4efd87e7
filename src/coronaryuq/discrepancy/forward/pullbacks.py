"""Readings of a wire along a path of vessels, from the pressures at the ends of these vessels.

The pressure at a distance x is that at the start of the path less the loss of every vessel up to x. Within a vessel the
loss is spread in proportion to the resistance of its radii (`radii` of the network, Poiseuille's law) or, where these
are not known, evenly. The loss of a focal stenosis falls between its start and its end. A vessel without a length, such
as one that was inserted for a loss, loses its pressure at one point.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from coronaryuq.case.network.topology import Topology
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, Sizes
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.pullback import CHECK, OF_WIRE, Pullback

Extents = Mapping[str, tuple[float, float]]
"""Inserted vessel → start and end of its loss in the vessel behind it, cm."""
REDUCE: dict[str, Callable[..., np.ndarray]] = {"mean": np.mean, "min": np.min, "max": np.max}


def extents(hypothesis: Hypothesis, sizes: Sizes, anatomy: Anatomy) -> Extents:
    """Return where the losses of the effects lie within their vessels."""
    pairs = zip(hypothesis, sizes, strict=True)
    found = [effect.extent(place, values, anatomy) for (effect, place), values in pairs]
    return {name: (start, end) for name, start, end in (extent for extent in found if extent is not None)}


def vessels_on(topology: Topology, pullback: Pullback) -> list[str]:
    """Return the vessels from the start to the end of a path, with those inserted in it or ahead of its first."""
    own, path = set(pullback.path), [pullback.path[-1]]
    while path[0] != pullback.path[0]:
        # Vessels form a tree.
        path.insert(0, topology.parents(path[0])[0])
    while parents := [p for p in topology.parents(path[0]) if p not in own and _ahead_of(topology, p, path[0])]:
        path.insert(0, parents[0])
    return path


def _ahead_of(topology: Topology, vessel: str, other: str) -> bool:
    """Whether a vessel was inserted ahead of another one, for a loss of that."""
    return topology.length(vessel) == 0.0 and topology.children(vessel) == [other]


def vessels_of_readings(topology: Topology, pullback: Pullback) -> list[str]:
    """Return the vessel of the path in which each reading lies, (k,)."""
    vessels = [vessel for vessel in pullback.path if topology.length(vessel) > 0.0]
    ends = np.cumsum([topology.length(vessel) for vessel in vessels])[:-1]
    return [vessels[number] for number in np.searchsorted(ends, pullback.distance, side="left")]


def pressures(topology: Topology, pullback: Pullback) -> list[str]:
    """Return the solver names of the pressures at the start of every vessel of a path, and at its end."""
    vessels = vessels_on(topology, pullback)
    return [f"pressure:{place}" for place in (*map(topology.inlet, vessels), topology.outlet(vessels[-1]))]


def shares(topology: Topology, pullback: Pullback, placed: Extents) -> np.ndarray:
    """Return the fraction (k, vessels) of each vessel's loss that lies ahead of each reading."""
    columns, start = [], 0.0
    for vessel in vessels_on(topology, pullback):
        given = topology.vessels[vessel].get("placed_in")
        first, last = placed.get(vessel) or ((given["start"], given["end"]) if given else (0.0, 0.0))
        length = topology.length(vessel)
        if length > 0.0:
            columns.append(_along(topology, vessel, (pullback.distance - start) / length))
            start += length
        elif last > first:
            columns.append(np.clip((pullback.distance - start - first) / (last - first), 0.0, 1.0))
        else:
            columns.append((pullback.distance >= start + first).astype(float))
    return np.array(columns).T


def _along(topology: Topology, vessel: str, part: np.ndarray) -> np.ndarray:
    """Return the fraction of a vessel's loss ahead of fractions of its length, (k,)."""
    part = np.clip(part, 0.0, 1.0)
    radii = np.asarray(topology.vessels[vessel].get("radii", ()), dtype=float)
    if radii.size < 2:
        return part
    a, b = radii[:-1], radii[1:]
    # Exact for a radius that is linear between points, as in the network's own resistance.
    resistance = np.concatenate([[0.0], np.cumsum((a**2 + a * b + b**2) / (a * b) ** 3)])
    return np.interp(part, np.linspace(0.0, 1.0, radii.size), resistance / resistance[-1])


def read(
    series: Series,
    waves: Mapping[str, np.ndarray],
    topology: Topology,
    placed: Sequence[Extents],
    root: str,
    pressure_factor: float,
) -> np.ndarray:
    """Return the readings (n, k) of a pullback, CGS.

    Parameters
    ----------
    series
        Readings of the pullback, or its drift check.
    waves
        Waveforms (n, steps + 1) of `pressures` by solver name, both ends of the cycle included.
    topology
        Of the network that was run.
    placed
        Extents of each of the n samples.
    root
        Solver name of the driving pressure, for a ratio.
    pressure_factor
        dyn/cm2 per unit of pressure of the network.
    """
    pullback = series.pullback
    if pullback is None:
        raise ValueError(f"{series.location} is no pullback")
    found = np.zeros((len(placed), pullback.distance.size))
    if series.quantity == CHECK:
        return found
    ends = np.stack([waves[name] for name in pressures(topology, pullback)], axis=1)
    if series.statistic == "mean":
        ends = ends[:, :, :-1].mean(axis=2, keepdims=True)
    ahead: dict[tuple, np.ndarray] = {}
    for number, extent in enumerate(placed):
        key = tuple(extent.items())
        if key not in ahead:
            ahead[key] = shares(topology, pullback, extent)
        course = ends[number, 0] - ahead[key] @ -np.diff(ends[number], axis=0)
        found[number] = REDUCE[series.statistic](course, axis=1)
    if series.quantity == f"{OF_WIRE}ratio":
        return found / waves[root][:, :-1].mean(axis=1)[:, None]
    return found * pressure_factor
