"""Centrelines as other programs write them: lines from the inlet to every end, segments of a graph, or a table.

Whatever the layout, the result is lines that start on one another, which are cut where they do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

from coronaryuq.case.anatomy.centrelines import own_radius
from coronaryuq.case.anatomy.simvascular import join_lines
from coronaryuq.case.anatomy.synthetic_aorta import is_aorta, one_tree
from coronaryuq.case.anatomy.tree import (
    AORTA,
    Tree,
    Vessel,
    parents_first,
    polylines,
    read_tree,
    read_trees,
    tree_of,
)
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import line_number, read_csv
from coronaryuq.core.io.vtk import read_vtk

if TYPE_CHECKING:
    import pyvista as pv

RADII = ("Radius", "radius", "MaximumInscribedSphereRadius", "InscribedSphereRadius", "Radii", "radii")
"""Point data that other programs call the radius: VMTK, 3D Slicer and SimVascular among them."""
NAMES = ("VesselName", "Name", "name", "Label", "label")
TABLES = (".csv", ".tsv", ".txt")
SAME, SAME_END = 1e-6, 1e-4
"""Distance over the extent of the tree below which two points are one, and a vessel starts at the end of another."""
FARTHEST = 1e5
"""cm: largest coordinate; a scanner's are below a hundred, or a thousandfold in a wrong unit."""
PARTED = 0.5
"""Lines with a common beginning have parted where they are this many radii from each other."""


def read_centrelines(path: str | Path, scale: float = 1.0) -> tuple[Tree, tuple[str, ...]]:
    """Read a tree from centrelines in any of these layouts.

    - A tree of `write_tree`: one polyline per vessel, with `VesselName`, `Parent`.
    - Polylines that start anywhere on one another, or that run from the inlet to every end and share their beginnings
      (VMTK, 3D Slicer); also split into tracts, with `CenterlineIds` and `TractIds`.
    - Segments of two points that form a graph (SimVascular).
    - A table of points: `name` of the vessel, `x`, `y`, `z`, `radius`; optional are `parent` and `branch`.

    Parameters
    ----------
    path : str or Path
        VTP, VTK, or CSV.
    scale : float
        Its length unit in cm.

    Returns
    -------
    tuple of Tree and tuple of str
        The tree, cm, and notes for the user.

    Raises
    ------
    InputError
        If there are no radii, or if the lines form a loop or do not touch one another.
    """
    path = Path(path)
    if path.suffix.lower() in TABLES:
        notes: list[str] = []
        return _of_table(path, scale, notes), tuple(notes)
    mesh, radius = _lines_of(path)
    cells = list(polylines(mesh.lines))
    names = next((name for name in NAMES if name in mesh.cell_data), None)
    if radius == "Radius" and names == "VesselName" and "Parent" in mesh.cell_data:
        trees, told = read_trees(path, scale), list[str]()
        if len(trees) > 1 and any(is_aorta(vessel) for tree in trees for vessel in tree):
            read_tree(path, scale)  # which says what is wrong
        return one_tree(path, trees, told), tuple(told)
    points, radii = np.asarray(mesh.points, float) * scale, np.asarray(mesh[radius], float) * scale
    if radii.ndim != 1 or not (np.isfinite(radii).all() and radii.min() > 0.0):
        raise InputError(path, radius, None, "expected one positive number per point")
    notes = [] if radius == "Radius" else [f"centrelines: took {radius} as the radius"]
    called = (
        [str(name).strip() for name in mesh.cell_data[names]] if names else [f"branch{k}" for k in range(len(cells))]
    )
    if "CenterlineIds" in mesh.cell_data and "TractIds" in mesh.cell_data:
        cells = _whole_lines(cells, mesh.cell_data["CenterlineIds"], mesh.cell_data["TractIds"])
        called = [f"branch{k}" for k in range(len(cells))]
    elif len(cells) > 1 and max(map(len, cells)) == 2:
        cells = _chains(path, points, radii, cells)
        called = [f"branch{k}" for k in range(len(cells))]
    lines = [_line(path, name, points[cell], radii[cell]) for name, cell in zip(called, cells, strict=True)]
    branches = [str(b).strip() for b in mesh.cell_data["Branch"]] if "Branch" in mesh.cell_data else []
    of_branch = dict(zip(called, branches, strict=True)) if len(branches) == len(called) else {}
    tree = _joined(path, lines, of_branch, notes, {})
    return tree, tuple(notes)


def _lines_of(path: Path) -> tuple["pv.PolyData", str]:
    """Return the polylines of a file, and the name of their radii."""
    import pyvista as pv

    mesh = read_vtk(path)
    if not isinstance(mesh, pv.PolyData) or mesh.n_lines == 0:
        raise InputError(path, None, None, "contains no polylines; expected centrelines, one polyline per vessel")
    if mesh.n_cells != mesh.n_lines:
        raise InputError(path, "cells", mesh.n_cells, f"{mesh.n_lines} of them are lines; keep the polylines only")
    radius = next((name for name in RADII if name in mesh.point_data), None)
    if radius is None:
        has = ", ".join(mesh.point_data) or "none"
        raise InputError(path, "Radius", None, f"point data missing; the file has {has}")
    return mesh, radius


def _of_table(path: Path, scale: float, notes: list[str]) -> Tree:
    import pandas as pd

    table = read_csv(path, ("name", "x", "y", "z", "radius"), words=("name", "parent", "branch"))
    if (nameless := table["name"] == "").any():
        line = line_number(path, int(np.argmax(nameless)))
        raise InputError(path, "name", None, f"line {line}: is blank; give every point the name of its vessel")
    for column in ("x", "y", "z", "radius"):
        given, table[column] = table[column], pd.to_numeric(table[column], errors="coerce")
        wrong = ~np.isfinite(table[column]) | ((table[column] <= 0.0) & (column == "radius"))
        if wrong.any():
            row, wanted = int(np.argmax(wrong)), "a positive number" if column == "radius" else "a number"
            raise InputError(path, column, str(given.iloc[row]), f"line {line_number(path, row)}: expected {wanted}")
    if table.empty:
        raise InputError(path, "rows", 0, "expected points of one vessel or more")
    lines = []
    for name, rows in table.groupby("name", sort=False):
        if len(rows) < 2:
            raise InputError(path, "name", str(name), "has one point; a vessel needs two or more")
        if len(rows) != rows.index[-1] - rows.index[0] + 1:
            raise InputError(path, "name", str(name), "its rows are not together; give each vessel its own name")
        values = rows[["x", "y", "z", "radius"]].to_numpy(float) * scale
        lines.append(_line(path, str(name), values[:, :3], values[:, 3]))
    of_branch = _first_of_each(table, "branch")
    stated = {name: parent for name, parent in _first_of_each(table, "parent").items() if parent}
    for name, parent in stated.items():
        if parent not in {line.name for line in lines}:
            raise InputError(path, f"parent of {name}", parent, "no such vessel in the table")
    return _joined(path, lines, of_branch, notes, stated)


def _first_of_each(table, column: str) -> dict[str, str]:
    if column not in table:
        return {}
    filled = table[column].fillna("").astype(str)
    return {str(name): rows.iloc[0] for name, rows in filled.groupby(table["name"], sort=False)}


def _line(path: Path, name: str, points: np.ndarray, radii: np.ndarray) -> Vessel:
    if (far := float(np.abs(points).max())) > FARTHEST:
        raise InputError(path, name, f"{far:.3g} cm", "no body reaches so far; check the coordinates and the unit")
    apart = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0])
    if apart.sum() < 2:
        raise InputError(path, name, int(apart.sum()), "different points; a vessel needs two or more")
    return Vessel(name, points[apart], radii[apart])


def _whole_lines(cells: Sequence[np.ndarray], lines, tracts) -> list[np.ndarray]:
    """Put the tracts of each centreline together, as they were before VMTK split them."""
    lines, tracts = np.asarray(lines), np.asarray(tracts)
    whole = []
    for line in np.unique(lines):
        own = np.flatnonzero(lines == line)
        whole.append(np.concatenate([cells[k] for k in own[np.argsort(tracts[own], kind="stable")]]))
    return whole


def _chains(path: Path, points: np.ndarray, radii: np.ndarray, cells: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the runs of points between the ends and branchings of a graph, away from its widest end."""
    _, node = np.unique(np.round(points / (SAME * np.ptp(points, axis=0).max())), axis=0, return_inverse=True)
    node = node.ravel()
    of_node = np.zeros(node.max() + 1, int)
    of_node[node[::-1]] = np.arange(len(node))[::-1]
    edges = np.unique(np.sort(node[np.array(cells)], axis=1), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    number = len(of_node)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(number, number)).tocsr()
    count, piece = connected_components(graph, directed=False)
    degree = np.bincount(edges.ravel(), minlength=number)
    used = np.unique(edges)
    chains: list[np.ndarray] = []
    for k in range(count):
        own = used[piece[used] == k]
        if not len(own):
            continue
        if (piece[edges[:, 0]] == k).sum() != len(own) - 1:
            raise InputError(path, None, None, "form a loop; grafts and other loops cannot be modelled")
        ends = own[degree[own] == 1]
        root = ends[np.argmax(radii[of_node[ends]])]
        order, before = breadth_first_order(graph, root, directed=False)
        for at in order[1:]:
            if degree[at] != 2:
                run = [at]
                while run[-1] != root and (len(run) == 1 or degree[run[-1]] == 2):
                    run.append(before[run[-1]])
                chains.append(of_node[run[::-1]])
    return chains


def _joined(
    path: Path, lines: list[Vessel], branches: Mapping[str, str], notes: list[str], stated: Mapping[str, str]
) -> Tree:
    """Join lines to a tree and give the parts of each its branch; stated: parents that a file names."""
    names = [line.name for line in lines]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(path, "name", twice, "duplicate; every vessel needs its own name")
    parents = _parents_by_ends(lines)
    if parents is not None:
        order = parents_first(path, names, parents)
        with tree_of(path):
            trees, line_of = [Tree(replace(lines[k], parent=parents[k]) for k in order)], {name: name for name in names}
    else:
        apart = _without_common_beginnings(lines)
        if len(apart) < len(lines):
            notes.append(f"centrelines: left out {len(lines) - len(apart)} of {len(lines)}, which are parts of others")
        trees, line_of = join_lines(path, apart)
    for vessel in (vessel for tree in trees for vessel in tree):
        line, parent = line_of[vessel.name], line_of.get(vessel.parent or "", "")
        if parent != line and stated.get(line, parent) != parent:
            raise InputError(path, f"parent of {line}", stated[line], f"but it starts on {parent or 'no other vessel'}")
    with tree_of(path):
        named = [Tree(replace(v, branch=branches.get(line_of[v.name]) or AORTA) for v in tree) for tree in trees]
    return one_tree(path, named, notes)


def _parents_by_ends(lines: list[Vessel]) -> list[str | None] | None:
    """Return the parents of vessels that all but one start where another one ends; None if they do not."""
    near = SAME_END * float(np.ptp(np.concatenate([line.points for line in lines]), axis=0).max())
    parents: list[str | None] = []
    for line in lines:
        gaps = [float(np.linalg.norm(other.points[-1] - line.points[0])) for other in lines if other is not line]
        others = [other.name for other in lines if other is not line]
        parents.append(others[int(np.argmin(gaps))] if gaps and min(gaps) < near else None)
    return parents if parents.count(None) == 1 else None


def _without_common_beginnings(lines: list[Vessel]) -> list[Vessel]:
    """Start each line where it parts from longer ones; a line that never does is left out."""
    kept: list[Vessel] = []
    for line in sorted(lines, key=lambda line: -line.length):
        if kept:
            cloud = np.concatenate([other.resampled(0.5 * float(other.radii.min())).points for other in kept])
            wide = np.concatenate([other.resampled(0.5 * float(other.radii.min())).radii for other in kept])
            distance, nearest = cKDTree(cloud).query(line.points)
            inside = distance < PARTED * np.minimum(line.radii, wide[nearest])
            if inside.all():
                continue
            first = int(np.argmin(inside)) - 1
            if first > 0:
                radii = own_radius(line.points[first:], line.radii[first:], float(wide[nearest[first]]))
                line = Vessel(line.name, line.points[first:], radii)
        kept.append(line)
    order = {line.name: k for k, line in enumerate(lines)}
    return sorted(kept, key=lambda line: order[line.name])
