"""What a user's file or folder is, and the ends of the vessels in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from coronaryuq.case.anatomy.centreline_files import TABLES, read_centrelines
from coronaryuq.case.anatomy.simvascular import is_project, read_project
from coronaryuq.case.anatomy.surface import SUFFIXES, Surface, read_surfaces
from coronaryuq.case.anatomy.synthetic_aorta import CORONARY, is_aorta
from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.case_json import AnatomyKind, Point
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.vtk import read_vtk
from coronaryuq.core.units import LENGTHS

EXPECTED = (
    "expected a SimVascular project (Paths, Segmentations), a mesh-complete folder, a surface (STL, VTP, PLY, OBJ), "
    "centrelines (VTP, CSV) or a 0D network (JSON)"
)
TYPICAL = 0.08
"""cm: radius of a coronary artery where CT loses it; the unit is the one that brings the ends nearest to it."""


@dataclass(frozen=True)
class End:
    """An end of the vessels: its name, its place in the file's unit, its radius (cm), and whether it is aortic."""

    name: str
    point: Point
    radius: float
    aortic: bool


@dataclass(frozen=True)
class Source:
    """A file or folder that holds a patient's vessels; groups: of a project's contours, where a path has several."""

    kind: AnatomyKind | Literal["network"]
    path: Path
    groups: tuple[str, ...] = ()

    @cached_property
    def units(self) -> dict[str, float]:
        """Length units in which the file makes sense → median radius (cm) of its coronary ends, most likely first.

        Raises
        ------
        InputError
            If it cannot be read in any unit.
        """
        radii, fault = {}, None
        for unit in LENGTHS:
            try:
                coronary = [end.radius for end in self.ends(unit) if not end.aortic]
            except InputError as error:  # some readers know how wide an artery may be
                fault = fault or error
                continue
            if coronary:
                radii[unit] = float(np.median(coronary))
        if not radii:
            raise fault or InputError(self.path, "radius", None, "every end is as wide as an aorta in any unit")
        return dict(sorted(radii.items(), key=lambda entry: abs(np.log(entry[1] / TYPICAL))))

    def ends(self, unit: str) -> list[End]:
        """Return the ends of the vessels if the file is in this length unit, the widest first."""
        scale = LENGTHS[unit]
        if self.kind in ("surface", "mesh"):
            found = [
                End(f"end{k + 1}", _point(cap.centre), cap.radius * scale, cap.radius * scale > CORONARY)
                for k, cap in enumerate(_largest_first(self._surfaces))
            ]
        else:
            tree, _ = self.tree(unit)
            found = [
                End(v.name, _point(v.points[-1] / scale), float(v.radii[-1]), v.made or is_aorta(v))
                for v in tree.leaves()
            ]
        return sorted(found, key=lambda end: -end.radius)

    def tree(self, unit: str) -> tuple[Tree, tuple[str, ...]]:
        """Return the tree of centrelines or of a project, cm, and notes on it."""
        if self.kind == "simvascular":
            return read_project(self.path, LENGTHS[unit], self.groups)
        return read_centrelines(self.path, LENGTHS[unit])

    @cached_property
    def _surfaces(self) -> list[Surface]:
        return read_surfaces(self.path / "mesh-complete.exterior.vtp" if self.kind == "mesh" else self.path)

    @property
    def pieces(self) -> list[list[str]]:
        """Names of the ends of each separate piece of a surface, the widest first."""
        order = [id(cap) for cap in _largest_first(self._surfaces)]
        return [[f"end{order.index(id(cap)) + 1}" for cap in surface.caps] for surface in self._surfaces]


def recognise(path: str | Path, groups: Sequence[str] = ()) -> Source:
    """Return what a path is.

    Raises
    ------
    InputError
        If it is missing, or nothing that has vessels.
    """
    path = Path(path)
    if path.is_dir():
        if is_project(path):
            return Source("simvascular", path, tuple(groups))
        if (path / "mesh-complete.exterior.vtp").is_file():
            return Source("mesh", path)
        inside = [name.name for name in sorted(path.iterdir()) if _may_have_vessels(name)]
        hint = f"; give what in this folder has the vessels: {', '.join(inside)}" if inside else ""
        raise InputError(path, None, None, EXPECTED + hint)
    if not path.is_file():
        raise InputError(path, None, None, f"no such file or folder; {EXPECTED}")
    suffix = path.suffix.lower()
    if suffix in TABLES:
        return Source("centrelines", path)
    if suffix == ".json":
        return Source("network", path)
    if suffix in (".vtp", ".vtk"):
        return Source(_of_polydata(path), path)
    if suffix in SUFFIXES:
        return Source("surface", path)
    raise InputError(path, None, path.suffix or None, f"unknown file type; {EXPECTED}")


def _may_have_vessels(path: Path) -> bool:
    """Return whether a name in a folder is one to try: a project, a folder of a mesh, a surface or centrelines."""
    if path.name.startswith("."):
        return False
    if path.is_dir():
        return is_project(path) or (path / "mesh-complete.exterior.vtp").is_file()
    return path.suffix.lower() in SUFFIXES


def _of_polydata(path: Path) -> AnatomyKind:
    import pyvista as pv

    mesh = read_vtk(path)
    if isinstance(mesh, pv.PolyData) and mesh.n_lines:
        return "centrelines"
    if isinstance(mesh, pv.PolyData) and mesh.n_cells:
        return "surface"
    raise InputError(path, None, None, "contains neither polylines nor a surface; export centrelines or the lumen")


def _largest_first(surfaces: Sequence[Surface]) -> list:
    return sorted((cap for surface in surfaces for cap in surface.caps), key=lambda cap: -cap.radius)


def _point(position: np.ndarray) -> Point:
    x, y, z = (float(value) for value in position)
    return x, y, z
