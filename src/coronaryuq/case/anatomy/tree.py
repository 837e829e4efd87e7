"""The centreline tree: vessels between bifurcations, with their radii, from the aortic root to the coronary outlets."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.case.case_json import CaseStenosis, FfrPlace
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.vtk import read_vtk, write_vtk

if TYPE_CHECKING:
    import pyvista

AORTA = "aorta"
TRUNK = "coronary"
CORONARY_BRANCHES = ("LM", "LAD", "LCx", "RCA", TRUNK)
BRANCHES = (AORTA, *CORONARY_BRANCHES)


@dataclass(frozen=True, eq=False)
class Vessel:
    """A vessel between two bifurcations.

    points: (n, 3) cm, from the parent's last point onwards. radii: (n,) cm. parent: name, None for the root.
    branch: "aorta", or the coronary artery that it belongs to: "LM", "LAD", "LCx" or "RCA"; "coronary" for a common
    trunk of other arteries than LAD and LCx (a single coronary artery). made: not in the patient's files.
    """

    name: str
    points: np.ndarray
    radii: np.ndarray
    parent: str | None = None
    branch: str = AORTA
    made: bool = False

    @cached_property
    def arc(self) -> np.ndarray:
        """Arc length of every point from the vessel's start, (n,) cm."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @property
    def length(self) -> float:
        return float(self.arc[-1])

    def radius_at(self, arc) -> np.ndarray:
        """Return the radius (cm) at arc length (cm), linear between points."""
        return np.interp(arc, self.arc, self.radii)

    def position_at(self, arc) -> np.ndarray:
        """Return the position (..., 3) cm at arc length (...) cm, linear between points."""
        return np.stack([np.interp(arc, self.arc, self.points[:, k]) for k in range(3)], axis=-1)

    def tangent_at(self, arc) -> np.ndarray:
        """Return the unit tangent (..., 3) at arc length (...) cm, averaged over about one radius on either side."""
        reach = np.maximum(self.radius_at(arc), 1e-6 * self.length)
        ahead = self.position_at(np.minimum(np.asarray(arc) + reach, self.length))
        behind = self.position_at(np.maximum(np.asarray(arc) - reach, 0.0))
        along = ahead - behind
        return along / np.linalg.norm(along, axis=-1, keepdims=True)

    def between(self, start: float, end: float) -> "Vessel":
        """Return the part from arc length `start` to `end` (cm), with points at both."""
        inside = (self.arc > start + 1e-9) & (self.arc < end - 1e-9)
        arc = np.concatenate([[start], self.arc[inside], [end]])
        return replace(self, points=self.position_at(arc), radii=self.radius_at(arc))

    def resampled(self, spacing: float) -> "Vessel":
        """Return the vessel with evenly spaced points, at most `spacing` (cm) apart."""
        arc = np.linspace(0.0, self.length, max(2, int(np.ceil(self.length / spacing)) + 1))
        return replace(self, points=self.position_at(arc), radii=self.radius_at(arc))


@contextmanager
def tree_of(path: str | Path) -> Iterator[None]:
    """Turn the ValueError of vessels that are no tree into an InputError that names their file."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(path, None, None, f"{error}; check points, radii, labels and the unit") from None


@dataclass(frozen=True)
class Stenosis:
    """A stenosis of one vessel between two arc lengths (cm); its name begins the names of its quantities.

    read: where its FFR is read, None if no place is asked for.
    """

    name: str
    vessel: str
    start: float
    end: float
    read: FfrPlace | None = None


def placed_stenoses(stenoses: Iterable[CaseStenosis]) -> list[Stenosis]:
    """Return the stenoses of `case.json` that have an extent along a vessel of the tree, in the same order."""
    return [
        Stenosis(s.name, s.vessel, s.start, s.end, s.read)
        for s in stenoses
        if s.start is not None and s.end is not None
    ]


class Tree:
    """Vessels by name, parents before children.

    Children start where their parent ends. A coronary artery starts on the aorta's centreline, so its first part lies
    inside the aortic lumen, which it leaves at `emergence`. Raises ValueError, with the vessel's name, if the vessels
    are not one tree.
    """

    def __init__(self, vessels: Iterable[Vessel]):
        self.vessels: dict[str, Vessel] = {}
        for vessel in vessels:
            self._admit(vessel)
        if not self.vessels:
            raise ValueError("a tree needs at least one vessel")

    def _admit(self, vessel: Vessel) -> None:
        points, radii = np.asarray(vessel.points, dtype=float), np.asarray(vessel.radii, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or radii.shape != (len(points),):
            raise ValueError(f"vessel {vessel.name}: expected two or more points with one radius each")
        if not (np.isfinite(points).all() and np.isfinite(radii).all() and (radii > 0).all()):
            raise ValueError(f"vessel {vessel.name}: points must be finite and radii positive")
        if (np.linalg.norm(np.diff(points, axis=0), axis=1) <= 0).any():
            raise ValueError(f"vessel {vessel.name}: repeats a point")
        if vessel.name in self.vessels:
            raise ValueError(f"vessel {vessel.name}: duplicate name")
        if vessel.branch not in BRANCHES:
            raise ValueError(f"vessel {vessel.name}: branch {vessel.branch!r} is none of {', '.join(BRANCHES)}")
        if vessel.parent is None and self.vessels:
            raise ValueError(f"vessel {vessel.name}: a second root, in addition to {self.root.name}")
        if vessel.parent is not None:
            if vessel.parent not in self.vessels:
                raise ValueError(f"vessel {vessel.name}: its parent {vessel.parent} does not come before it")
            parent = self.vessels[vessel.parent]
            gap = float(np.linalg.norm(points[0] - parent.points[-1]))
            if gap > max(1e-6, 1e-3 * parent.radii[-1]):
                raise ValueError(f"vessel {vessel.name}: starts {gap:.3g} cm from the end of {parent.name}")
        self.vessels[vessel.name] = replace(vessel, points=points, radii=radii)

    def __iter__(self) -> Iterator[Vessel]:
        return iter(self.vessels.values())

    def __getitem__(self, name: str) -> Vessel:
        return self.vessels[name]

    def __contains__(self, name: str) -> bool:
        return name in self.vessels

    def __len__(self) -> int:
        return len(self.vessels)

    @property
    def root(self) -> Vessel:
        return next(iter(self.vessels.values()))

    def children(self, name: str) -> list[Vessel]:
        """Return the vessels that start at the end of `name`."""
        return [v for v in self if v.parent == name]

    def leaves(self) -> list[Vessel]:
        """Return the vessels without children."""
        parents = {v.parent for v in self}
        return [v for v in self if v.name not in parents]

    def path(self, name: str) -> list[Vessel]:
        """Return the vessels from the root to `name`, both included."""
        path = [self[name]]
        while path[0].parent is not None:
            path.insert(0, self[path[0].parent])
        return path

    def subtree(self, name: str) -> list[Vessel]:
        """Return `name` and every vessel downstream of it."""
        inside = [self[name]]
        for vessel in inside:
            inside.extend(self.children(vessel.name))
        return inside

    def ostial(self, vessel: Vessel) -> bool:
        """Return whether this coronary artery arises from the aorta."""
        return vessel.branch != AORTA and vessel.parent is not None and self[vessel.parent].branch == AORTA

    def emergence(self, name: str) -> float:
        """Return the arc length (cm) at which an ostial vessel leaves the aortic lumen; 0 for any other vessel.

        The lumen is that of the aortic vessels that meet at the vessel's start.
        """
        vessel = self[name]
        if not self.ostial(vessel):
            return 0.0
        parent = str(vessel.parent)
        aorta = [self[parent], *(v for v in self.children(parent) if v.branch == AORTA)]
        arc = np.linspace(0.0, vessel.length, max(50, int(vessel.length / 0.02)))
        depth = np.min([distance_to(part, vessel.position_at(arc)) for part in aorta], axis=0)
        outside = np.flatnonzero(depth >= 0)
        if len(outside) == 0:
            raise ValueError(f"vessel {name}: never leaves the aorta; check the radii (not diameters) and the unit")
        first = int(outside[0])
        return 0.0 if first == 0 else float(np.interp(0.0, depth[first - 1 : first + 1], arc[first - 1 : first + 1]))

    def nearest(self, point, among: Iterable[str] | None = None) -> tuple[str, float, float]:
        """Return vessel, arc length (cm) and distance (cm) of the centreline position nearest to `point` (3,) cm."""
        best = ("", 0.0, np.inf)
        for vessel in self if among is None else (self[name] for name in among):
            arc, distance = project(vessel, point)
            if distance < best[2]:
                best = (vessel.name, arc, distance)
        return best

    def with_vessels(self, changed: dict[str, Vessel]) -> "Tree":
        """Return the tree with some vessels replaced by others of the same name."""
        return Tree(changed.get(v.name, v) for v in self)


def branch_of(fed: set[str]) -> str:
    """Return the branch of a vessel that feeds ends of the branches `fed`.

    It is theirs if they agree, LM upstream of LAD and LCx, a coronary trunk upstream of other arteries, and the aorta
    if an aortic end is among them.
    """
    if len(fed) == 1:
        return next(iter(fed))
    if not fed or AORTA in fed:
        return AORTA
    return "LM" if fed == {"LAD", "LCx"} else TRUNK


def project(vessel: Vessel, point) -> tuple[float, float]:
    """Return the arc length (cm) of the position on the polyline nearest to `point`, and its distance (cm)."""
    start, along = vessel.points[:-1], np.diff(vessel.points, axis=0)
    share = np.clip(((np.asarray(point) - start) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    distance = np.linalg.norm(start + share[:, None] * along - point, axis=1)
    k = int(np.argmin(distance))
    return float(vessel.arc[k] + share[k] * (vessel.arc[k + 1] - vessel.arc[k])), float(distance[k])


def distance_to(vessel: Vessel, points: np.ndarray) -> np.ndarray:
    """Return the signed distance (n,) cm of `points` (n, 3) from the vessel's wall, negative inside.

    The lumen consists of linearly tapered segments.
    """
    start, along = vessel.points[:-1], np.diff(vessel.points, axis=0)
    offset = points[:, None, :] - start
    share = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
    radius = vessel.radii[:-1] + share * np.diff(vessel.radii)
    return (np.linalg.norm(offset - share[..., None] * along, axis=2) - radius).min(axis=1)


def reference_radius(vessel: Vessel, start: float, end: float, arc) -> np.ndarray:
    """Return the radius (cm) without the stenosis: linear in arc length between its two ends."""
    return np.interp(arc, [start, end], vessel.radius_at([start, end]))


def throat(tree: Tree, stenosis: Stenosis) -> tuple[float, float]:
    """Return the arc length (cm) and radius (cm) of the narrowest point of a stenosis."""
    part = tree[stenosis.vessel].between(stenosis.start, stenosis.end)
    k = int(np.argmin(part.radii))
    return stenosis.start + float(part.arc[k]), float(part.radii[k])


def area_ratio(tree: Tree, stenosis: Stenosis) -> float:
    """Return A_s / A_0, the lumen area at the throat over the area there without the stenosis (1: no narrowing)."""
    arc, radius = throat(tree, stenosis)
    healthy = reference_radius(tree[stenosis.vessel], stenosis.start, stenosis.end, arc)
    return float((radius / healthy) ** 2)


def write_tree(path: str | Path, tree: Tree) -> None:
    """Write `tree.vtp`: a polyline per vessel in cm; point data Radius; cell data VesselName, Parent, Branch."""
    import pyvista as pv

    lines, offset = [], 0
    for vessel in tree:
        n = len(vessel.points)
        lines.append(np.concatenate([[n], np.arange(offset, offset + n)]))
        offset += n
    mesh = pv.PolyData(np.concatenate([v.points for v in tree]), lines=np.concatenate(lines))
    mesh.point_data["Radius"] = np.concatenate([v.radii for v in tree])
    mesh.cell_data["VesselName"] = [v.name for v in tree]
    mesh.cell_data["Parent"] = [v.parent or "" for v in tree]
    mesh.cell_data["Branch"] = [v.branch for v in tree]
    write_vtk(path, mesh)


def read_tree(path: str | Path, scale: float = 1.0) -> Tree:
    """Read a tree written by `write_tree`, or polylines of the same layout in another length unit.

    `VesselName` and `Parent` may be absent: vessels are then named `branch0`, `branch1`, ... and joined by their ends.

    Parameters
    ----------
    path : str or Path
        VTP file.
    scale : float
        Its length unit in cm.

    Returns
    -------
    Tree
        In cm.

    Raises
    ------
    InputError
        If data are missing or the polylines are not one tree.
    """
    trees = read_trees(path, scale)
    if len(trees) > 1:
        roots = ", ".join(tree.root.name for tree in trees)
        remedy = "more than one root vessel; all but one must start on another vessel"
        raise InputError(path, "Parent", roots, remedy)
    return trees[0]


def read_trees(path: str | Path, scale: float = 1.0) -> list[Tree]:
    """Read separate trees as `read_tree` reads one; raises InputError likewise."""
    import pyvista as pv

    mesh = read_vtk(path)
    if not isinstance(mesh, pv.PolyData) or mesh.n_lines == 0:
        raise InputError(path, None, None, "contains no polylines; expected one polyline per vessel")
    if "Radius" not in mesh.point_data:
        raise InputError(
            path, "Radius", None, f"point data missing; the file has {', '.join(mesh.point_data) or 'none'}"
        )
    if mesh.n_cells != mesh.n_lines:
        raise InputError(path, "cells", mesh.n_cells, f"{mesh.n_lines} of them are lines; keep the polylines only")
    points, radii = np.asarray(mesh.points, dtype=float) * scale, np.asarray(mesh["Radius"], dtype=float) * scale
    cells = [np.asarray(cell) for cell in polylines(mesh.lines)]
    names = [str(n).strip() for n in _cell_data(mesh, "VesselName", [f"branch{i}" for i in range(len(cells))])]
    if len(set(names)) != len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise InputError(path, "VesselName", twice, "duplicate; every vessel needs its own name")
    if "Parent" in mesh.cell_data:
        parents = [str(p).strip() or None for p in mesh.cell_data["Parent"]]
    else:
        parents = _join_by_ends([points[c] for c in cells], names)
    branches = [str(b).strip() for b in _cell_data(mesh, "Branch", [AORTA] * len(cells))]
    order = parents_first(path, names, parents)
    vessels = [Vessel(names[i], points[cells[i]], radii[cells[i]], parents[i], branches[i]) for i in order]
    with tree_of(path):
        return separate_trees(vessels)


def separate_trees(vessels: Sequence[Vessel]) -> list[Tree]:
    """Return the trees of vessels, parents before children, one per vessel without a parent."""
    of_root: dict[str, list[Vessel]] = {}
    root_of: dict[str, str] = {}
    for vessel in vessels:
        root = root_of[vessel.name] = vessel.name if vessel.parent is None else root_of[vessel.parent]
        of_root.setdefault(root, []).append(vessel)
    return [Tree(own) for own in of_root.values()]


def _cell_data(mesh: "pyvista.DataSet", name: str, default: list[str]) -> Iterable[str]:
    values = mesh.cell_data.get(name)
    return default if values is None else values


def polylines(lines: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the point numbers of each polyline of VTK's flat list."""
    start = 0
    while start < len(lines):
        n = int(lines[start])
        yield lines[start + 1 : start + 1 + n]
        start += 1 + n


def _join_by_ends(polylines: list[np.ndarray], names: list[str]) -> list[str | None]:
    """Return the parent of each polyline, the one that ends where it starts, if there is one."""
    span = max(float(np.ptp(np.concatenate(polylines), axis=0).max()), 1e-9)
    parents: list[str | None] = []
    for i, line in enumerate(polylines):
        gaps = [float(np.linalg.norm(other[-1] - line[0])) if j != i else np.inf for j, other in enumerate(polylines)]
        parents.append(names[int(np.argmin(gaps))] if min(gaps, default=np.inf) < 1e-4 * span else None)
    return parents


def parents_first(path, names: list[str], parents: list[str | None]) -> list[int]:
    """Return the order in which every vessel comes after its parent."""
    placed: list[int] = []
    done: set[str | None] = {None}
    while len(placed) < len(names):
        ready = next((i for i in range(len(names)) if i not in placed and parents[i] in done), None)
        if ready is None:
            stuck = next(n for i, n in enumerate(names) if i not in placed)
            raise InputError(path, "Parent", stuck, "its parent is missing or the parents form a ring")
        placed.append(ready)
        done.add(names[ready])
    return placed
