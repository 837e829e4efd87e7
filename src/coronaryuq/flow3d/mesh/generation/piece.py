"""One piece of the mesh, from implicit surface to checked tetrahedra."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.flow3d.mesh.generation import quality, volume
from coronaryuq.flow3d.mesh.geometry import clip_caps
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.grading import Grading, stand_off
from coronaryuq.flow3d.mesh.geometry.implicit import SignedDistance
from coronaryuq.flow3d.mesh.geometry.paths import Cap, Size
from coronaryuq.flow3d.mesh.geometry.surface import WALL, enclosed_volume, surface

THINNEST = 0.05
"""Smallest radius ratio of a tetrahedron (1 is regular) that may result from drawing nodes to the wall."""

INSET = 0.25
"""Distance behind a cap, in its radii, at which the isosurface is cut, so that the cut is flat and its rim clean."""

SHORTEST = 0.02
"""Edges of a given surface shorter than this fraction of the smallest radius are removed."""

WORST_DIHEDRAL = 3.0
"""Degrees; a piece with a flatter tetrahedron is meshed again with other settings."""


@dataclass(frozen=True)
class Attempt:
    """What differs between attempts.

    spacing, deviation: grid spacing and surface deviation in smallest radii; shortest: shortest edge in smallest sizes;
    sharp: angle (degrees) from which an edge of the wall is kept sharp; scale: factor on the element size; own: whether
    a given surface's own triangles are used; stretched: whether elements may be stretched.
    """

    spacing: float
    deviation: float
    shortest: float
    sharp: float
    scale: float
    own: bool = False
    stretched: bool = True


ATTEMPTS = (
    Attempt(0.60, 0.25, 0.40, 120.0, 1.0, own=True),
    Attempt(0.50, 0.30, 0.70, 179.0, 0.97, own=True),
    Attempt(0.43, 0.20, 0.25, 90.0, 0.94),
    Attempt(0.37, 0.35, 0.50, 75.0, 0.91, stretched=False),
    Attempt(0.30, 0.15, 0.30, 120.0, 0.88, stretched=False),
)


@dataclass(frozen=True)
class Piece:
    """Points (n, 3) in cm, positive tetrahedra (m, 4), outward triangles (k, 3) and their references (k,).

    A reference is 1 for the wall, 2 + i for cap i.
    """

    points: np.ndarray
    tets: np.ndarray
    triangles: np.ndarray
    refs: np.ndarray


def mesh_implicit(implicit: SignedDistance, caps: Sequence[Cap], radius: float, attempt: Attempt, **shape) -> Piece:
    """Mesh the inside of an implicit surface cut at `caps`.

    radius: the smallest of the piece, cm; shape: size, gradation and grading.
    """
    start = surface(implicit, caps, attempt.spacing * radius)
    return _mesh(start, implicit, caps, radius=radius, attempt=attempt, **shape)


def mesh_closed(
    points: np.ndarray,
    triangles: np.ndarray,
    faces: Sequence[np.ndarray],
    implicit: SignedDistance,
    caps: Sequence[Cap],
    radius: float,
    attempt: Attempt,
    **shape,
) -> Piece:
    """Mesh the inside of a closed surface from its own triangles or, in later attempts, from its isosurface.

    faces: the triangles of each cap. The isosurface repairs what cuts or touches itself, but needs the grid spacing of
    the smallest vessel everywhere.
    """
    if not attempt.own:
        behind = [replace(cap, centre=cap.centre - INSET * cap.radius * cap.normal) for cap in caps]
        return mesh_implicit(implicit, behind, radius, attempt, **shape)
    start = clip_caps.trimmed(points, triangles, faces, caps, SHORTEST * radius)
    flat = [replace(cap, centre=cap.centre - clip_caps.INSET * cap.radius * cap.normal) for cap in caps]
    return _mesh(start, implicit, flat, radius=radius, attempt=attempt, **shape)


def _mesh(
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    implicit: SignedDistance,
    caps: Sequence[Cap],
    size: Size,
    radius: float,
    gradation: float,
    grading: Grading,
    attempt: Attempt,
) -> Piece:
    """Fill a closed surface, given as vertices, outward triangles and references, with tetrahedra."""
    points, triangles, refs = start

    def project(nodes: np.ndarray) -> np.ndarray:
        return implicit.project(nodes, 1e-3 * radius)

    size = size.varied(attempt.scale, attempt.stretched)
    enclosed = enclosed_volume(points, triangles)
    knobs = (attempt.deviation * radius, gradation, attempt.shortest, attempt.sharp)
    points, triangles, refs = volume.remesh_surface(points, triangles, refs, size, *knobs)
    points, tets = volume.fill(points, triangles)
    points, tets, triangles, refs = volume.remesh_volume(points, tets, triangles, refs, size, *knobs)
    triangles, refs = volume.outer_references(tets, triangles, refs)
    points = _fit(points, tets, triangles, refs, caps, project)
    points = _graded(points, tets, triangles, refs, implicit, grading, 1e-3 * radius)
    piece = _compact(Piece(points, tets, triangles, refs))
    check(piece, caps, enclosed)
    return piece


def _fit(points, tets, triangles, refs, caps: Sequence[Cap], project: Callable) -> np.ndarray:
    """Move wall nodes onto the surface, cap nodes into the plane of their cap, rim nodes onto both."""
    wall = np.unique(triangles[refs == WALL])
    target = points.copy()
    target[wall] = project(points[wall])
    for index, cap in enumerate(caps):
        nodes = np.unique(triangles[refs == index + 2])
        rim = np.intersect1d(nodes, wall)
        for _ in range(3):
            target[rim] = project(target[rim])
            target[nodes] -= ((target[nodes] - cap.centre) @ cap.normal)[:, None] * cap.normal
    nodes = np.unique(triangles)
    return volume.fit_to_surface(points, tets, nodes, target[nodes], quality.radius_ratio)


def _graded(points, tets, triangles, refs, implicit: SignedDistance, grading: Grading, step: float) -> np.ndarray:
    """Draw inner nodes to the wall at a throat, and move wall nodes out until the lumen has its volume."""
    inner = np.setdiff1d(np.unique(tets), triangles)
    target = grading(points[inner], -implicit.distance(points[inner]))
    points = volume.fit_to_surface(points, tets, inner, target, quality.radius_ratio, THINNEST)
    nodes, target = stand_off(points, triangles[refs == WALL], implicit, step)
    free = ~np.isin(nodes, triangles[refs != WALL])
    return volume.fit_to_surface(points, tets, nodes[free], target[free], quality.radius_ratio, THINNEST)


def _compact(piece: Piece) -> Piece:
    """Drop points that no tetrahedron uses."""
    used = np.unique(piece.tets)
    new = np.full(len(piece.points), -1)
    new[used] = np.arange(len(used))
    return Piece(piece.points[used], new[piece.tets], new[piece.triangles], piece.refs)


def check(piece: Piece, caps: Sequence[Cap], enclosed: float) -> None:
    """Raise `MeshError` for a piece that lost volume, a cap or its shape."""
    volumes = quality.volumes(piece.points, piece.tets)
    if volumes.min() <= 0.0:
        raise MeshError(f"{int((volumes <= 0.0).sum())} inverted tetrahedra")
    if abs(volumes.sum() / enclosed - 1.0) > 0.1:
        raise MeshError(f"mesh volume is {volumes.sum() / enclosed:.3f} of the surface's")
    flattest = float(quality.dihedral_angles(piece.points, piece.tets).min())
    if flattest < WORST_DIHEDRAL:
        raise MeshError(f"smallest dihedral angle {flattest:.1f} degrees")
    for index, cap in enumerate(caps):
        area = quality.areas(piece.points, piece.triangles[piece.refs == index + 2]).sum(axis=0)
        if not 0.6 < float(area @ cap.normal) / (np.pi * cap.radius**2) < 1.5:
            raise MeshError(f"cap {cap.name} lost its area")
    _check_connected(piece)
    _check_manifold(piece.triangles)


def _check_connected(piece: Piece) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(piece.points)
    i, j = np.concatenate([piece.tets[:, pair] for pair in quality.EDGES]).T
    count, _ = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)
    if count != 1:
        raise MeshError(f"falls into {count} parts")


def _check_manifold(triangles: np.ndarray) -> None:
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    if np.any(count != 2):
        raise MeshError(f"{int((count != 2).sum())} edges of the boundary do not belong to two triangles")
