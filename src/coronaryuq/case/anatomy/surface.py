"""Read a lumen surface (STL, VTP, PLY), close it, and find its flat caps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from coronaryuq.case.anatomy.stl import read_stl
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.vtk import read_vtk

SUFFIXES = (".stl", ".vtp", ".ply", ".obj", ".vtk")
MOST_TRIANGLES = 5_000_000
FLAT = np.cos(np.radians(10.0))
"""Smallest ratio of a cap's area projected along its normal to its area."""
SHARP = (40.0, 25.0, 15.0)
"""Degrees between the normals of neighbours at which the surface is cut, one after the other."""
SLIVER = 1e-3
"""Area over longest edge squared, below which a triangle is a sliver."""
FEWEST = 4
"""Minimum number of triangles of a cap."""
SPURIOUS_RIM = 4
"""A hole with fewer rim points is a defect of the file, not an open end."""
WELD = 1e-6
"""Distance, relative to the surface's extent, below which points are merged."""


@dataclass(frozen=True, eq=False)
class Cap:
    """A flat end of the lumen: centre (3,) cm, outward unit normal, radius (cm) of a disc of its area, triangles."""

    centre: np.ndarray
    normal: np.ndarray
    radius: float
    faces: np.ndarray

    def __str__(self) -> str:
        x, y, z = self.centre
        return f"({x:.2f}, {y:.2f}, {z:.2f}) radius {self.radius:.3f} cm"


@dataclass(frozen=True)
class Surface:
    """A closed triangulated lumen: points (n, 3) cm, triangles (m, 3) turned outwards, caps by falling size."""

    points: np.ndarray
    triangles: np.ndarray
    caps: list[Cap]
    notes: tuple[str, ...]

    def polydata(self):
        """Return the surface as pyvista PolyData."""
        import pyvista as pv

        faces = np.column_stack([np.full(len(self.triangles), 3), self.triangles])
        return pv.PolyData(self.points, faces.ravel())


def read_surface(path: str | Path, scale: float = 1.0) -> Surface:
    """Read the largest piece of a surface as `read_surfaces` reads all of them."""
    return read_surfaces(path, scale)[0]


def read_surfaces(path: str | Path, scale: float = 1.0) -> list[Surface]:
    """Read the pieces of a surface, the largest first; close their open ends with flat caps, and find all caps.

    A smaller piece without two caps is no vessel and left out; the first one has the notes on the file.

    Parameters
    ----------
    path
        STL, VTP, PLY, OBJ or VTK file.
    scale
        The file's length unit in cm.

    Raises
    ------
    InputError
        If the file is missing or contains no surface, edges are shared by more than two triangles, or the largest piece
        has fewer than two caps.
    """
    import pyvista as pv

    path = Path(path)
    if not path.is_file():
        raise InputError(path, None, None, "no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(path, None, path.suffix, f"unknown file type; known types: {', '.join(SUFFIXES)}")
    notes: tuple[str, ...] = ()
    if path.suffix.lower() == ".stl":
        corners, notes = read_stl(path)
        numbers: Any = np.arange(3 * len(corners)).reshape(-1, 3)
        mesh = pv.PolyData.from_regular_faces(corners.reshape(-1, 3), numbers)
    else:
        mesh = read_vtk(path)
    if not isinstance(mesh, pv.PolyData) or mesh.n_cells == 0:
        raise InputError(path, None, None, "contains no surface; export the lumen as triangles (STL, VTP, PLY)")
    mesh.clear_data()
    mesh = mesh.triangulate().clean(tolerance=WELD, absolute=False)
    if mesh.n_cells == 0 or mesh.n_verts + mesh.n_lines == mesh.n_cells:
        raise InputError(path, "triangles", 0, "contains points or lines alone; export the lumen as triangles")
    if mesh.n_cells > MOST_TRIANGLES:
        raise InputError(path, "triangles", mesh.n_cells, f"more than {MOST_TRIANGLES}; decimate the surface")
    points = np.asarray(mesh.points, dtype=float) * scale
    triangles = np.asarray(mesh.regular_faces)
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    pieces = _pieces(points, triangles)
    surfaces = [_closed(points, pieces[0], path)]
    for piece in pieces[1:]:
        try:
            surfaces.append(_closed(points, piece, path))
        except InputError:  # a fragment or a calcification
            continue
    if len(surfaces) < len(pieces):
        notes += (f"surface: kept {len(surfaces)} of {len(pieces)} pieces, those with flat ends",)
    return [replace(surfaces[0], notes=(*notes, *surfaces[0].notes)), *surfaces[1:]]


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Return several pieces as one surface."""
    if len(surfaces) == 1:
        return surfaces[0]
    points = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    faces = np.cumsum([0, *(len(surface.triangles) for surface in surfaces)])
    caps = [
        replace(cap, faces=cap.faces + first)
        for surface, first in zip(surfaces, faces, strict=False)
        for cap in surface.caps
    ]
    return Surface(
        np.concatenate([surface.points for surface in surfaces]),
        np.concatenate([surface.triangles + first for surface, first in zip(surfaces, points, strict=False)]),
        sorted(caps, key=lambda cap: -cap.radius),
        tuple(note for surface in surfaces for note in surface.notes),
    )


def surface_of(points: np.ndarray, triangles: np.ndarray, path: str | Path = "surface") -> Surface:
    """Return the closed surface of the largest piece of points (n, 3) cm and triangles (m, 3)."""
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    pieces = _pieces(points, triangles)
    surface = _closed(points, pieces[0], path)
    left_out = (f"surface: kept the largest of {len(pieces)} pieces",) if len(pieces) > 1 else ()
    return replace(surface, notes=(*left_out, *surface.notes))


def _closed(points: np.ndarray, triangles: np.ndarray, path: str | Path) -> Surface:
    """Return the closed surface of one piece, with its caps."""
    notes: list[str] = []
    triangles, superfluous = _without_fins(triangles)
    if superfluous:
        notes.append(f"surface: removed {superfluous} triangles that are duplicates or not part of the surface (fins)")
    edges, count = np.unique(np.sort(_edges(triangles), axis=1), axis=0, return_counts=True)
    if (count > 2).any():
        raise InputError(path, "edges", int((count > 2).sum()), "shared by more than two triangles; repair the surface")
    triangles, flipped = _oriented(points, triangles)
    if flipped:
        notes.append(f"surface: flipped {flipped} triangles for a consistent orientation")
    points, triangles, closed = _close(path, points, triangles, edges[count == 1])
    notes += closed
    used, renumbered = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], renumbered.reshape(-1, 3)
    if _signed_volume(points, triangles) < 0:
        triangles = triangles[:, ::-1]
    caps = find_caps(points, triangles)
    if len(caps) < 2:
        remedy = (
            "flat ends found; expected at least an inlet (aorta or ostium) and one coronary outlet, cut flat with a "
            "sharp rim"
        )
        raise InputError(path, "caps", len(caps), remedy)
    return Surface(points, triangles, caps, tuple(notes))


def find_caps(points: np.ndarray, triangles: np.ndarray) -> list[Cap]:
    """Find flat regions with a round, sharp, convex rim, the largest first.

    The surface is cut at its sharp edges, first at the sharpest. A region is a cap if it is flat and about round, has
    four or more triangles, and meets the rest at a convex, sharp edge along most of its rim.
    """
    normals, areas = _normals(points, triangles)
    pairs, edges = _neighbours(triangles)
    normals = _without_slivers(points, triangles, normals, areas, pairs, edges)
    turn = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1)
    centroids = points[triangles].mean(axis=1)
    across = centroids[pairs[:, 1]] - centroids[pairs[:, 0]]
    # Thin triangles lie in both planes: an edge is concave only if the neighbour clearly rises.
    convex = (across * normals[pairs[:, 0]]).sum(axis=1) < 0.02 * np.linalg.norm(across, axis=1)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    n = len(triangles)
    caps: list[Cap] = []
    taken = np.zeros(n, dtype=bool)
    for sharpest in SHARP:
        joined = turn > np.cos(np.radians(sharpest))
        graph = coo_matrix((np.ones(joined.sum()), (pairs[joined, 0], pairs[joined, 1])), shape=(n, n))
        count, region = connected_components(graph, directed=False)
        border = region[pairs[:, 0]] != region[pairs[:, 1]]
        sharp = border & convex & (turn < np.cos(np.radians(SHARP[-1])))
        rim, sharp_rim = np.zeros(count), np.zeros(count)
        for side in (0, 1):
            np.add.at(rim, region[pairs[border, side]], length[border])
            np.add.at(sharp_rim, region[pairs[sharp, side]], length[sharp])
        order = np.argsort(region, kind="stable")
        starts = np.searchsorted(region[order], np.arange(count + 1))
        for k in np.flatnonzero((sharp_rim > 0.8 * rim) & (rim > 0)):
            faces = np.sort(order[starts[k] : starts[k + 1]])
            cap = _cap(points, triangles, faces, normals, areas, rim[k])
            if cap is not None and not taken[faces].any():
                caps.append(cap)
                taken[faces] = True
    return sorted(_with_a_vessel_behind(points, triangles, caps), key=lambda cap: -cap.radius)


def _with_a_vessel_behind(points: np.ndarray, triangles: np.ndarray, caps: list[Cap], ways: int = 16) -> list[Cap]:
    """Drop flat facets of a vessel's side wall: the lumen extends sideways behind these, but not behind a cap."""
    import pyvista as pv

    if not caps:
        return caps
    angle = 2 * np.pi * np.arange(ways) / ways
    probes = []
    for cap in caps:
        across = np.linalg.svd(cap.normal[None])[2][1:]
        ring = np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1]
        probes.append(cap.centre + cap.radius * (1.6 * ring - 1.5 * cap.normal))
    surface = pv.PolyData.from_regular_faces(points, triangles)
    depth = pv.PolyData(np.concatenate(probes)).compute_implicit_distance(surface)["implicit_distance"]
    inside = (np.asarray(depth).reshape(-1, ways) < 0).mean(axis=1)
    return [cap for cap, share in zip(caps, inside, strict=True) if share < 0.3]


def _without_slivers(points, triangles, normals, areas, pairs, edges, passes: int = 20) -> np.ndarray:
    """Replace the meaningless normal of each sliver by that of its neighbour across the longest edge."""
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    sliver = areas < SLIVER * longest**2
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    takers, givers = [], []
    for side in (0, 1):
        taker = pairs[:, side]
        take = sliver[taker] & (length > 0.999 * longest[taker])
        takers.append(taker[take])
        givers.append(pairs[take, 1 - side])
    taker, giver = np.concatenate(takers), np.concatenate(givers)
    normals = normals.copy()
    for _ in range(passes):
        normals[taker] = normals[giver]
    return normals


def _cap(points, triangles, faces: np.ndarray, normals, areas, rim: float) -> Cap | None:
    area = areas[faces].sum()
    normal = (normals[faces] * areas[faces, None]).sum(axis=0)
    straight = float(np.linalg.norm(normal))
    if len(faces) < FEWEST or straight < FLAT * area or 4 * np.pi * area < 0.5 * rim**2:
        return None
    normal = normal / straight
    centre = (points[triangles[faces]].mean(axis=1) * areas[faces, None]).sum(axis=0) / area
    radius = float(np.sqrt(area / np.pi))
    if np.abs((points[triangles[faces]] - centre) @ normal).max() > 0.2 * radius:
        return None
    return Cap(centre, normal, radius, faces)


def _edges(triangles: np.ndarray) -> np.ndarray:
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def _neighbours(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of triangles (k, 2) that share an edge, and that edge's points (k, 2)."""
    edges = np.sort(_edges(triangles), axis=1)
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    return np.stack([owner[same], owner[same + 1]], axis=1), edges[same]


def _normals(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (m, 3) and areas (m,)."""
    normals = np.cross(*_sides(points, triangles))
    double = np.linalg.norm(normals, axis=1)
    return normals / np.maximum(double, 1e-300)[:, None], double / 2


def _signed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] - points.mean(axis=0) for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


def _pieces(points: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Return the triangles of each connected piece, the one with most of them first."""
    edges = _edges(triangles)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(points),) * 2)
    _, piece = connected_components(graph, directed=False)
    of_triangle = piece[triangles[:, 0]]
    names, count = np.unique(of_triangle, return_counts=True)
    return [triangles[of_triangle == name] for name in names[np.argsort(-count, kind="stable")]]


def _without_fins(triangles: np.ndarray) -> tuple[np.ndarray, int]:
    """Remove duplicate triangles and fins; also return the number removed.

    A fin has one edge in common with two other triangles, and one edge with none.
    """
    before = len(triangles)
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    triangles = triangles[np.sort(first)]
    while True:
        _, edge, count = np.unique(np.sort(_edges(triangles), axis=1), axis=0, return_inverse=True, return_counts=True)
        shared = count[edge.ravel()].reshape(3, -1)
        fin = (shared > 2).any(axis=0) & (shared == 1).any(axis=0)
        if not fin.any():
            return triangles, before - len(triangles)
        triangles = triangles[~fin]


def _oriented(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, int]:
    """Orient triangles consistently, as most of them are; also return the number flipped."""
    import pyvista as pv

    if len(np.unique(_edges(triangles), axis=0)) == 3 * len(triangles):
        return triangles, 0
    consistent = pv.PolyData.from_regular_faces(points, triangles).compute_normals(
        point_normals=False, consistent_normals=True, auto_orient_normals=False, split_vertices=False
    )
    oriented = np.asarray(consistent.regular_faces)
    flipped = (np.cross(*_sides(points, oriented)) * np.cross(*_sides(points, triangles))).sum(axis=1) < 0
    if 2 * flipped.sum() > len(triangles):
        return oriented[:, ::-1], len(triangles) - int(flipped.sum())
    return oriented, int(flipped.sum())


def _sides(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return b - a, c - a


def _close(path, points: np.ndarray, triangles: np.ndarray, open_edges: np.ndarray):
    """Close every hole by a fan around its centre, a spurious one by a single triangle; also return notes."""
    notes = []
    for rim in _loops(path, open_edges, triangles):
        if len(rim) < SPURIOUS_RIM:
            triangles = np.vstack([triangles, rim[::-1]])
            notes.append(
                f"surface: closed a spurious hole of {len(rim)} points at {np.round(points[rim[0]], 2).tolist()}"
            )
            continue
        centre = len(points)
        points = np.vstack([points, points[rim].mean(axis=0)])
        fan = np.stack([np.roll(rim, -1), rim, np.full(len(rim), centre)], axis=1)
        triangles = np.vstack([triangles, fan])
        notes.append(f"surface: closed an open end of {len(rim)} points")
    return points, triangles, notes


def _loops(path, open_edges: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Return the rims of holes, each in the direction of the triangles along it."""
    if len(open_edges) == 0:
        return []
    wanted = {tuple(edge) for edge in open_edges.tolist()}
    after: dict[int, int] = {}
    for a, b in _edges(triangles).tolist():
        if (min(a, b), max(a, b)) in wanted:
            if a in after:
                raise InputError(path, "edges", None, "two holes touch at a point; repair the surface")
            after[a] = b
    loops = []
    while after:
        first, here = next(iter(after.items()))
        loop = [first]
        del after[first]
        while here != first:
            loop.append(here)
            if here not in after:
                raise InputError(
                    path, "edges", None, "the rim of a hole is not closed; repair the surface's orientation"
                )
            here = after.pop(here)
        loops.append(np.array(loop))
    return loops
