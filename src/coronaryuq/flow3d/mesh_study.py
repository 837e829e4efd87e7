"""Numerical error of the quantities of interest, from three meshes and a halved time step."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from coronaryuq.core import provenance, records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json

ORDER = 2.0
"""Theoretical order of the discretisation in the element size; higher observed orders are not used."""
LEAST_ORDER = 1.0
"""Observed order below which three meshes are too coarse for an extrapolation."""
SAFETY = 1.25
"""Safety factor of the grid convergence index on three meshes (Roache 1998)."""
QUANTITIES = ("ffr_", "tawss_", "osi_")


def mesh_study(
    meshes: Mapping[str, tuple[str | Path, str | Path]], own: str, halved_step: str | Path, out_json: str | Path
) -> dict:
    """Estimate the mesh and time-step error of every quantity of interest, and write it.

    Parameters
    ----------
    meshes
        Mesh name → `mesh.json`, and the records of the samples run on it.
    own
        Name of the campaign's mesh.
    halved_step
        Records of the same samples on the campaign's mesh with half its time step.
    out_json
        Where the result is written.

    Returns
    -------
    dict
        What was written. Per quantity, the result of `richardson` for the means over the samples that every mesh has,
        coarsest mesh first; `spread`, the standard deviation over these samples of the difference between the two
        finest meshes; `step_error`, see `step_errors`. `checksum` is that of the campaign's `mesh.json`, so that a
        reader can tell whether the study is of the mesh at hand.

    Raises
    ------
    InputError
        No sample was finished on every mesh, or two meshes are equally fine.
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
    """Collect the quantities of interest of the samples that every mesh has.

    Parameters
    ----------
    meshes
        Mesh name → `mesh.json`, and files of records.
    place
        File or folder that errors name.

    Returns
    -------
    tuple
        Names of the meshes, coarsest first; their numbers of nodes; the common samples; quantity → values (mesh,
        sample).

    Raises
    ------
    InputError
        No sample was finished on every mesh, or two meshes are equally fine.
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
        raise InputError(place, "nodes", None, "the meshes are equally fine; an imported mesh folder cannot be refined")
    first = read[order[0]][1][common[0]]
    quantities = sorted(quantity for quantity in first if quantity.startswith(QUANTITIES))
    return order, nodes, common, {
        quantity: np.array([[read[name][1][s][quantity] for s in common] for name in order]) for quantity in quantities
    }  # fmt: skip


def step_errors(whole: str | Path, half: str | Path, quantities: Sequence[str], place: str | Path) -> dict[str, float]:
    """Return the error of the time step per quantity: twice the change of the mean when the step is halved.

    whole, half: records of the same samples on one mesh. Twice, because the convecting velocity is that of the step's
    beginning, so the error is of first order and halving the step removes half of it.
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
    """Estimate the discretisation error from values on meshes of decreasing element size.

    Parameters
    ----------
    size
        (k,) element sizes, coarsest first.
    values
        (k,) the quantity on these meshes.
    own
        Index of the mesh whose error is wanted.

    Returns
    -------
    dict
        `converging`: the values approach a limit monotonically with an observed order of at least one. Then
        `extrapolated` is the limit from the two finest meshes and the observed order (at most two), and `error` is the
        grid convergence index, 1.25 times the distance to it. Otherwise `extrapolated` is None and `error` is the range
        of all values, which is no bound.

    References
    ----------
    Roache 1998, Verification and Validation in Computational Science and Engineering.
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
    """Return the observed order, at most `highest`, from element sizes (3,) and the ratio of the two differences."""

    def miss(power: float) -> float:
        a, b, c = (size / size[1]) ** power
        return (a - b) / (b - c) - ratio

    lowest = 1e-3
    if miss(lowest) > 0:
        return 0.0
    return highest if miss(highest) < 0 else float(brentq(miss, lowest, highest))
