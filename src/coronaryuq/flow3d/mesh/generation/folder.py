"""SimVascular `mesh-complete/` folders: write, pack to reproducible bytes, read and check."""

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing
from coronaryuq.core.io.text import visible
from coronaryuq.core.io.vtk import read_vtk, write_vtk
from coronaryuq.flow3d.mesh.generation.quality import areas, boundary, volumes
from coronaryuq.flow3d.mesh.generation.volume import oriented

VOLUME = "mesh-complete.mesh.vtu"
EXTERIOR = "mesh-complete.exterior.vtp"
WALLS = "walls_combined.vtp"
SURFACES = "mesh-surfaces"
WALL = "wall"
_EPOCH = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Mesh:
    """A tetrahedral mesh with named faces.

    points (n, 3) cm; tets (m, 4), positively oriented; triangles (k, 3) outward, owner (k,) the tetrahedron behind
    each, face (k,) the ModelFaceID of each; names: ModelFaceID → face name, walls starting with `wall`; region (k,)
    number of the stenosis region that a wall triangle belongs to, 0 for none.
    """

    points: np.ndarray
    tets: np.ndarray
    triangles: np.ndarray
    owner: np.ndarray
    face: np.ndarray
    names: Mapping[int, str]
    region: np.ndarray

    @property
    def caps(self) -> dict[int, str]:
        return {number: name for number, name in self.names.items() if not name.startswith(WALL)}

    def wall_triangles(self) -> np.ndarray:
        """Return which triangles are wall, boolean (k,)."""
        return ~np.isin(self.face, list(self.caps))


def write(folder: str | Path, mesh: Mesh) -> None:
    """Write the folder as SimVascular does: VTK XML, ids from 1."""
    import pyvista as pv

    folder = Path(folder)
    (folder / SURFACES).mkdir(parents=True, exist_ok=True)
    nodes = np.arange(1, len(mesh.points) + 1, dtype=np.int32)
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: mesh.tets}, mesh.points)
    grid.point_data["GlobalNodeID"] = nodes
    grid.cell_data["GlobalElementID"] = np.arange(1, len(mesh.tets) + 1, dtype=np.int32)
    grid.cell_data["ModelRegionID"] = np.ones(len(mesh.tets), np.int32)
    write_vtk(folder / VOLUME, grid)
    write_vtk(folder / EXTERIOR, _surface(mesh, np.ones(len(mesh.face), bool)))
    write_vtk(folder / WALLS, _surface(mesh, mesh.wall_triangles()))
    for number, name in mesh.names.items():
        write_vtk(folder / SURFACES / f"{name}.vtp", _surface(mesh, mesh.face == number))


def _surface(mesh: Mesh, chosen: np.ndarray):
    import pyvista as pv

    used = np.unique(mesh.triangles[chosen])
    local = np.searchsorted(used, mesh.triangles[chosen])
    surface = pv.PolyData.from_regular_faces(mesh.points[used], local)
    surface.point_data["GlobalNodeID"] = (used + 1).astype(np.int32)
    surface.cell_data["GlobalElementID"] = (mesh.owner[chosen] + 1).astype(np.int32)
    surface.cell_data["ModelFaceID"] = mesh.face[chosen].astype(np.int32)
    surface.cell_data["Region"] = mesh.region[chosen].astype(np.int32)
    return surface


def pack(folder: str | Path, archive: str | Path) -> None:
    """Store a mesh-complete folder in a zip, with sorted names and no times, so that equal meshes are equal bytes."""
    folder = Path(folder)
    with replacing(archive) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_STORED) as packed:
        for path in sorted(p for p in folder.rglob("*") if p.is_file()):
            entry = zipfile.ZipInfo(f"mesh-complete/{path.relative_to(folder).as_posix()}", _EPOCH)
            entry.external_attr = 0o644 << 16
            packed.writestr(entry, path.read_bytes())


def unpack(archive: str | Path, out_dir: str | Path) -> None:
    """Unpack an archive of `pack` into `out_dir`/mesh-complete.

    Parameters
    ----------
    archive
        `mesh-complete.zip`.
    out_dir
        Receives `mesh-complete/`.

    Raises
    ------
    InputError
        The archive is missing, broken or holds files outside `mesh-complete/`.
    """
    try:
        with zipfile.ZipFile(archive) as packed:
            names, torn = packed.namelist(), packed.testzip()
    except FileNotFoundError:
        raise InputError(archive, None, None, "no such file") from None
    # All that zipfile may raise for a broken archive; OSError if an offset points outside the file.
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError):
        raise InputError(archive, None, None, "not a zip archive; make the mesh again") from None
    if torn is not None:
        raise InputError(archive, "entry", torn, "is corrupted; make the mesh again")
    for name in names:
        if not name.startswith("mesh-complete/") or ".." in Path(name).parts:
            raise InputError(archive, "entry", name, "lies outside mesh-complete/; make the mesh again")
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(out_dir)


def read(folder: str | Path) -> Mesh:
    """Read and check a mesh-complete folder, from SimVascular or from here.

    Raises `InputError`, naming the file, for a missing file or array, cells that are not tetrahedra, faces that do not
    cover the boundary, or ids that do not match the volume mesh.
    """
    folder = Path(folder)
    grid = _load(folder / VOLUME)
    cells = grid.cells_dict
    import pyvista as pv

    if set(cells) != {pv.CellType.TETRA}:
        raise InputError(
            folder / VOLUME, "cells", None, "expected linear tetrahedra only; mesh again without other cells"
        )
    ids = _array(grid.point_data, "GlobalNodeID", folder / VOLUME)
    points = np.asarray(grid.points, float)
    place = {int(number): index for index, number in enumerate(ids)}
    if len(place) != len(points):
        raise InputError(folder / VOLUME, "GlobalNodeID", None, "ids are not unique; export the mesh again")
    tets = oriented(points, np.asarray(cells[pv.CellType.TETRA], np.int64))
    flat = np.flatnonzero(volumes(points, tets) <= 0.0)
    if len(flat):
        raise InputError(
            folder / VOLUME, f"cell {flat[0]}", None, f"has no volume, nor do {len(flat) - 1} others; mesh again"
        )
    triangles, owner = boundary(tets)
    lookup = {tuple(key): index for index, key in enumerate(np.sort(triangles, axis=1).tolist())}
    face = np.zeros(len(triangles), np.int64)
    region = np.zeros(len(triangles), np.int64)
    names: dict[int, str] = {}
    surfaces = list(visible(folder / SURFACES, "*.vtp"))
    if not surfaces:
        raise InputError(folder / SURFACES, None, None, "contains no .vtp; every face needs one")
    for path in surfaces:
        number = _read_face(path, place, lookup, face, region)
        if number in names:
            raise InputError(path, "ModelFaceID", number, f"also used by {names[number]}; give each face its own")
        names[number] = path.stem
    if np.any(face == 0):
        raise InputError(
            folder / SURFACES, None, None, f"{int((face == 0).sum())} boundary triangles belong to no face"
        )
    return Mesh(points, tets, triangles, owner, face, dict(sorted(names.items())), region)


def _read_face(path: Path, place: dict, lookup: dict, face: np.ndarray, region: np.ndarray) -> int:
    surface = _load(path)
    numbers = np.unique(_array(surface.cell_data, "ModelFaceID", path))
    if len(numbers) != 1 or numbers[0] <= 0:
        raise InputError(path, "ModelFaceID", numbers.tolist(), "expected one positive number for the whole face")
    ids = _array(surface.point_data, "GlobalNodeID", path)
    try:
        nodes = np.array([place[int(number)] for number in ids])
        corners = nodes[surface.regular_faces]
        rows = np.array([lookup[tuple(key)] for key in np.sort(corners, axis=1).tolist()])
    except (KeyError, ValueError):
        raise InputError(path, "GlobalNodeID", None, "does not lie on the boundary of the volume mesh") from None
    if np.any(face[rows] != 0):
        raise InputError(path, None, None, "shares triangles with another face")
    face[rows] = numbers[0]
    if "Region" in surface.cell_data:
        region[rows] = np.asarray(surface.cell_data["Region"])
    return int(numbers[0])


def _load(path: Path):
    data = read_vtk(path)
    if data.n_cells == 0:
        raise InputError(path, None, None, "contains no cells; make it again")
    return data


def _array(data, name: str, path: Path) -> np.ndarray:
    if name not in data:
        raise InputError(path, name, None, f"array missing; the file has {', '.join(data.keys()) or 'none'}")
    return np.asarray(data[name])


def face_geometry(mesh: Mesh, number: int) -> dict:
    """Return area (cm2), centroid (cm), outward unit normal and equivalent radius (cm) of one face."""
    chosen = mesh.triangles[mesh.face == number]
    vector = areas(mesh.points, chosen)
    size = np.linalg.norm(vector, axis=1)
    total = vector.sum(axis=0)
    return {
        "area": float(size.sum()),
        "centroid": ((mesh.points[chosen].mean(axis=1) * size[:, None]).sum(axis=0) / size.sum()).tolist(),
        "normal": (total / max(float(np.linalg.norm(total)), 1e-300)).tolist(),
        "radius": float(np.sqrt(size.sum() / np.pi)),
    }
