"""Tetrahedra of one piece: mmgs on the surface, TetGen inside, mmg3d on both."""

from collections.abc import Callable

import numpy as np

from coronaryuq.flow3d.mesh.generation.quality import boundary, volumes
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.paths import Size


def remesh_surface(
    points: np.ndarray,
    triangles: np.ndarray,
    refs: np.ndarray,
    size: Size,
    deviation: float,
    gradation: float,
    shortest: float,
    sharp: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Remesh a surface to edges of the wanted size; triangles keep their reference, borders between them stay sharp.

    deviation: allowed Hausdorff distance, cm; shortest: smallest edge as a fraction of the smallest size; sharp: angle
    in degrees from which an edge stays sharp.
    """
    import mmgpy

    mesh = mmgpy.MmgMeshS()
    rims = borders(triangles, refs)
    mesh.set_mesh_size(vertices=len(points), triangles=len(triangles), edges=len(rims))
    mesh.set_vertices(points)
    mesh.set_triangles(triangles.astype(np.int32), refs.astype(np.int32))
    _keep_sharp(mesh, rims)
    smallest = _ask(mesh, size, points)
    mesh.remesh(hausd=deviation, hgrad=gradation, ar=sharp, hmin=smallest * shortest, verbose=-1)
    triangles, refs = mesh.get_triangles_with_refs()
    return np.asarray(mesh.get_vertices(), float), np.asarray(triangles, np.int64), np.asarray(refs, np.int64)


def fill(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points, the surface's own first, and tetrahedra inside a closed surface, which is kept as it is."""
    import tetgen

    mesher = tetgen.TetGen(points, triangles.astype(np.int32))
    try:
        mesher.tetrahedralize(switches="pYq1.4Q")
    except RuntimeError as error:
        raise MeshError(f"TetGen could not fill the surface ({error})") from None
    return np.asarray(mesher.node, float), np.asarray(mesher.elem, np.int64)


def remesh_volume(
    points: np.ndarray,
    tets: np.ndarray,
    triangles: np.ndarray,
    refs: np.ndarray,
    size: Size,
    deviation: float,
    gradation: float,
    shortest: float,
    sharp: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return points, tetrahedra, boundary triangles and references after mmg3d; arguments as in `remesh_surface`."""
    import mmgpy

    mesh = mmgpy.MmgMesh3D()
    rims = borders(triangles, refs)
    mesh.set_mesh_size(vertices=len(points), tetrahedra=len(tets), triangles=len(triangles), edges=len(rims))
    mesh.set_vertices(points)
    mesh.set_tetrahedra(tets.astype(np.int32))
    mesh.set_triangles(triangles.astype(np.int32), refs.astype(np.int32))
    _keep_sharp(mesh, rims)
    smallest = _ask(mesh, size, points)
    mesh.remesh(hausd=deviation, hgrad=gradation, ar=sharp, hmin=smallest * shortest, verbose=-1)
    triangles, refs = mesh.get_triangles_with_refs()
    points, tets = np.asarray(mesh.get_vertices(), float), np.asarray(mesh.get_tetrahedra(), np.int64)
    return points, oriented(points, tets), np.asarray(triangles, np.int64), np.asarray(refs, np.int64)


def borders(triangles: np.ndarray, refs: np.ndarray) -> np.ndarray:
    """Return the edges (k, 2) between triangles of different references."""
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    order = np.lexsort(edges.T[::-1])
    edges, side = edges[order], np.tile(refs, 3)[order]
    return edges[::2][side[::2] != side[1::2]]


def _ask(mesh, size: Size, points: np.ndarray) -> float:
    """Give mmg the wanted sizes at its vertices; return the smallest width, cm."""
    wanted = size(points)
    if size.stretched:
        mesh.set_field("tensor", size.metric(points))
    else:
        mesh.set_field("metric", wanted[:, None])
    return float(wanted.min())


def _keep_sharp(mesh, rims: np.ndarray) -> None:
    if len(rims):
        mesh.set_edges(rims.astype(np.int32), np.full(len(rims), 1, np.int32))
        mesh.set_ridge_edges(np.arange(len(rims), dtype=np.int32))


def oriented(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return tetrahedra renumbered to positive volume."""
    tets = tets.copy()
    inverted = volumes(points, tets) < 0.0
    tets[inverted] = tets[inverted][:, [0, 1, 3, 2]]
    return tets


def outer_references(tets: np.ndarray, triangles: np.ndarray, refs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return outward boundary triangles (k, 3) and their references (k,), looked up in `triangles`."""
    outer, _ = boundary(tets)
    known = {tuple(key): ref for key, ref in zip(np.sort(triangles, axis=1).tolist(), refs.tolist(), strict=True)}
    try:
        return outer, np.array([known[tuple(key)] for key in np.sort(outer, axis=1).tolist()])
    except KeyError:
        raise MeshError("mmg lost the reference of a boundary triangle") from None


def fit_to_surface(
    points: np.ndarray, tets: np.ndarray, nodes: np.ndarray, target: np.ndarray, quality: Callable, least: float = 0.2
) -> np.ndarray:
    """Move `nodes` to `target`, less far where a tetrahedron would lose half its quality and fall below `least`."""
    shift = np.zeros_like(points)
    shift[nodes] = target - points[nodes]
    share = np.ones(len(points))
    floor = np.minimum(least, 0.5 * quality(points, tets))
    for _ in range(20):
        bad = quality(points + share[:, None] * shift, tets) < floor
        if not bad.any():
            return points + share[:, None] * shift
        share[np.unique(tets[bad])] *= 0.5
    return points
