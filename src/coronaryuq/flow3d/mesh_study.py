"""Numerical error of the quantities of interest: the same samples on a coarser, the campaign's, and a finer mesh, and
on the campaign's mesh again with half its time step.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from coronaryuq.core import provenance, records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json

ORDER = 2.0
"""Of the discretisation in the element size: linear elements, second-order steps. No higher one is believed."""
LEAST_ORDER = 1.0
"""Below it three meshes are too coarse to extrapolate from."""
SAFETY = 1.25
"""Of the grid convergence index on three meshes that show their order (Roache 1998)."""
QUANTITIES = ("ffr_", "tawss_", "osi_")


def mesh_study(
    meshes: Mapping[str, tuple[str | Path, str | Path]], own: str, halved_step: str | Path, out_json: str | Path
) -> dict:
    """Write and return what three meshes and half the time step say of every quantity's numerical error.

    meshes: name → (mesh.json, records of the samples run on it); own: the name of the campaign's mesh; halved_step:
    records of the samples on that mesh with half its time step. Per quantity, what `richardson` says of the means over
    the samples that every mesh has, coarsest mesh first; `spread`, the standard deviation over these samples of the
    difference between the two finest meshes; `step_error`, see `step_errors`. `checksum` is of the campaign's
    mesh.json, for a reader to see whether the study is of the mesh at hand.
    """
    order, nodes, samples, found = compare({name: (mesh, [batch]) for name, (mesh, batch) in meshes.items()}, out_json)
    size = np.array(nodes, float) ** (-1 / 3)
    step = step_errors(meshes[own][1], halved_step, list(found), out_json)
    content = {
        "meshes": order,
        "own": own,
        "checksum": provenance.checksum(meshes[own][0]),
        "nodes": nodes,
        "samples": samples,
        "quantities": {
            quantity: richardson(size, every.mean(axis=1).tolist(), order.index(own))
            | {"spread": float(np.std(every[-1] - every[-2])), "step_error": step[quantity]}
            for quantity, every in found.items()
        },
    }
    write_json(out_json, content)
    return content


def compare(
    meshes: Mapping[str, tuple[str | Path, Sequence[str | Path]]], place: str | Path
) -> tuple[list[str], list[int], list[str], dict[str, np.ndarray]]:
    """Names of the meshes, coarsest first, their nodes, the samples that all have, quantity → values (mesh, sample).

    meshes: name → (mesh.json, files of records). place: what an error is laid to. Raises `InputError` where no sample
    was finished on every mesh, or two meshes are equally fine.
    """
    read = {}
    for name, (mesh_json, batches) in meshes.items():
        read[name] = (read_json(mesh_json)["nodes"], _finished(*batches))
    order = sorted(read, key=lambda name: read[name][0])
    nodes = [read[name][0] for name in order]
    common = sorted(set.intersection(*(set(done) for _, done in read.values())))
    if not common:
        raise InputError(place, "samples", None, "no sample was finished on every mesh; see the records' reasons")
    if len(set(nodes)) < len(nodes):
        raise InputError(place, "nodes", None, "the meshes are equally fine: a given mesh folder cannot be refined")
    first = read[order[0]][1][common[0]]
    quantities = sorted(quantity for quantity in first if quantity.startswith(QUANTITIES))
    return order, nodes, common, {
        quantity: np.array([[read[name][1][s][quantity] for s in common] for name in order]) for quantity in quantities
    }  # fmt: skip


def step_errors(whole: str | Path, half: str | Path, quantities: Sequence[str], place: str | Path) -> dict[str, float]:
    """Error of the time step, quantity by quantity: twice the change of the mean when the step is halved.

    whole, half: records of the same samples on one mesh. Twice, because blood is carried by the velocity of the step's
    beginning, which is of first order, so that as much again is left to come.
    """
    runs = _finished(whole), _finished(half)
    common = sorted(set(runs[0]) & set(runs[1]))
    if not common:
        raise InputError(place, "samples", None, "no sample was finished with half the time step; see the records")
    return {
        quantity: 2.0 * abs(float(np.mean([runs[1][s][quantity] - runs[0][s][quantity] for s in common])))
        for quantity in quantities
    }


def _finished(*batches: str | Path) -> dict[str, dict[str, float]]:
    return {row.sample: row.outputs for batch in batches for row in records.read(batch) if row.ok}


def richardson(size: np.ndarray, values: Sequence[float], own: int) -> dict:
    """What values on meshes of falling element size (k,) say of the error of the one at index `own`.

    `converging`: the values approach a limit from one side with an observed order of one at least. Then `extrapolated`
    is that limit by the two finest meshes and the observed order, two at most, and `error` is the grid convergence
    index, 1.25 times the distance to it (Roache 1998). Otherwise `extrapolated` is None and `error` is the range of all
    values: what is seen, and no bound.
    """
    steps = np.diff(values)
    monotone = bool((steps > 0).all() or (steps < 0).all())
    shrinking = monotone and bool((np.abs(steps[1:]) < np.abs(steps[:-1])).all())
    order = _order(size[-3:], steps[-2] / steps[-1]) if len(values) > 2 and shrinking else None
    seen = {"values": list(values), "order": order}
    if order is None or order < LEAST_ORDER:
        return seen | {"converging": False, "extrapolated": None, "error": float(np.ptp(values))}
    share = (size[-1] / size[-2]) ** min(order, ORDER)
    extrapolated = float((values[-1] - share * values[-2]) / (1.0 - share))
    error = SAFETY * abs(values[own] - extrapolated)
    return seen | {"converging": True, "extrapolated": extrapolated, "error": error}


def _order(size: np.ndarray, ratio: float, highest: float = 16.0) -> float:
    """The power of the element size (3,) that the ratio of two successive steps tells, `highest` at most."""

    def miss(power: float) -> float:
        a, b, c = (size / size[1]) ** power
        return (a - b) / (b - c) - ratio

    lowest = 1e-3
    if miss(lowest) > 0:
        return 0.0
    return highest if miss(highest) < 0 else float(brentq(miss, lowest, highest))
