"""Mesh error of the quantities of interest: the same samples on a coarser, the campaign's, and a finer mesh."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from coronaryuq import files, records
from coronaryuq.errors import InputError

ORDER = 2.0
"""Of the discretisation in the element size: linear elements, second-order steps."""
QUANTITIES = ("ffr_", "tawss_", "osi_")


def mesh_study(meshes: Mapping[str, tuple[str | Path, str | Path]], own: str, out_json: str | Path) -> dict:
    """Write and return what three meshes say of every quantity's mesh error.

    meshes: name → (mesh.json, records of the samples run on it); own: the name of the campaign's mesh. Per quantity:
    `values` by mesh, coarsest first, as means over the samples that all have; `extrapolated` by Richardson from the two
    finest, with order two; `order` observed on three meshes, where they converge; `error` of the campaign's mesh, an
    absolute bar: its distance to the extrapolated value where the values are monotone and approach it, or else their
    whole range, since nothing better is known then.
    """
    read = {}
    for name, (mesh_json, batch) in meshes.items():
        done = {row.sample: row.outputs for row in records.read(batch) if row.ok}
        read[name] = (files.read_json(mesh_json)["nodes"], done)
    order = sorted(read, key=lambda name: read[name][0])
    common = sorted(set.intersection(*(set(done) for _, done in read.values())))
    if not common:
        raise InputError(out_json, "samples", None, "no sample was finished on every mesh; see the records' reasons")
    if len({nodes for nodes, _ in read.values()}) < len(read):
        raise InputError(out_json, "nodes", None, "the meshes are equally fine: a given mesh folder cannot be refined")
    size = np.array([read[name][0] for name in order], float) ** (-1 / 3)
    found = {}
    for quantity in sorted(read[own][1][common[0]]):
        if quantity.startswith(QUANTITIES):
            values = [float(np.mean([read[name][1][s][quantity] for s in common])) for name in order]
            found[quantity] = richardson(size, values, order.index(own))
    content = {
        "meshes": order,
        "own": own,
        "nodes": [read[name][0] for name in order],
        "samples": common,
        "quantities": found,
    }
    files.write_json(out_json, content)
    return content


def richardson(size: np.ndarray, values: Sequence[float], own: int) -> dict:
    """What values on meshes of falling element size (k,) say of the error of the one at index `own`."""
    steps = np.diff(values)
    share = (size[-1] / size[-2]) ** ORDER
    extrapolated = float((values[-1] - share * values[-2]) / (1.0 - share))
    monotone = bool((steps > 0).all() or (steps < 0).all())
    converging = monotone and bool((np.abs(steps[1:]) < np.abs(steps[:-1])).all())
    error = abs(values[own] - extrapolated) if converging else float(np.ptp(values))
    observed = _order(size, steps[0] / steps[1]) if len(values) == 3 and converging else None
    return {
        "values": list(values),
        "extrapolated": extrapolated if converging else None,
        "order": observed,
        "error": error,
    }


def _order(size: np.ndarray, ratio: float, highest: float = 8.0) -> float | None:
    """The power of the element size (3,) that the ratio of the two steps tells, if one below `highest` does."""

    def miss(power: float) -> float:
        a, b, c = (size / size[1]) ** power
        return (a - b) / (b - c) - ratio

    lowest = 1e-3
    return float(brentq(miss, lowest, highest)) if miss(lowest) * miss(highest) < 0 else None
