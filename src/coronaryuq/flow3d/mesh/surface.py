"""Closed triangulated surface of one piece: marching cubes on the signed distance, caps cut flat."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.flow3d.mesh.errors import MeshError
from coronaryuq.flow3d.mesh.implicit import Implicit
from coronaryuq.flow3d.mesh.paths import Cap

GRID_LIMIT = 400_000_000
"""Points of the largest grid, 1.6 GB."""

WALL = 1
"""Reference of wall triangles; cap number i has i + 2."""


def surface(implicit: Implicit, caps: Sequence[Cap], spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (n, 3), outward triangles (m, 3) and references (m,) of a closed surface cut at `caps`.

    spacing: of the grid, cm; half the smallest radius or less. Raises MeshError, naming the cap that could not be cut.
    """
    from skimage.measure import marching_cubes

    try:
        values, origin = implicit.grid(spacing, GRID_LIMIT)
    except MemoryError as error:
        raise MeshError(f"{error} is too large: mesh fewer or wider vessels (domain `segments`)") from None
    points, triangles, _, _ = marching_cubes(values, 0.0, spacing=(spacing,) * 3, mask=values < 1e8)
    points = implicit.project(points.astype(float) + origin, 0.01 * spacing, iterations=2)
    del values
    body = _solid(points, triangles)
    for cap in caps:
        body = body - _cutter(cap, spacing)
    parts = sorted(body.decompose(), key=lambda part: -part.volume())
    mesh = parts[0].to_mesh()
    points = np.asarray(mesh.vert_properties, float)[:, :3]
    triangles = np.asarray(mesh.tri_verts, np.int64)
    return points, triangles, references(points, triangles, caps)


def _solid(points: np.ndarray, triangles: np.ndarray):
    import manifold3d

    body = manifold3d.Manifold(
        manifold3d.Mesh(vert_properties=points.astype(np.float32), tri_verts=triangles.astype(np.uint32))
    )
    if body.status() != manifold3d.Error.NoError or body.is_empty():
        raise MeshError(f"marching cubes left a surface that is not a solid ({body.status().name})")
    if body.volume() < 0.0:
        return _solid(points, triangles[:, ::-1])
    return body


def _cutter(cap: Cap, spacing: float):
    """Cylinder that takes away what the path has beyond its cap."""
    import manifold3d

    side = np.cross(cap.normal, np.eye(3)[np.argmin(np.abs(cap.normal))])
    side /= np.linalg.norm(side)
    frame = np.column_stack([side, np.cross(cap.normal, side), cap.normal, cap.centre])
    radius = 1.5 * cap.radius + spacing
    return manifold3d.Manifold.cylinder(2.3 * cap.radius + spacing, radius, radius, 64).transform(frame)


def references(points: np.ndarray, triangles: np.ndarray, caps: Sequence[Cap]) -> np.ndarray:
    """Reference of every triangle (m,): `WALL`, or 2 + index of the cap in whose plane it lies."""
    centre = points[triangles].mean(axis=1)
    normal = np.cross(
        points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
    )
    area = 0.5 * np.linalg.norm(normal, axis=1)
    found = np.full(len(triangles), WALL)
    for index, cap in enumerate(caps):
        offset = np.abs((points[triangles] - cap.centre) @ cap.normal).max(axis=1)
        near = np.linalg.norm(centre - cap.centre, axis=1) < 2.0 * cap.radius
        mine = near & (offset < 1e-3 * cap.radius)
        found[mine] = index + 2
        ratio = area[mine].sum() / (np.pi * cap.radius**2)
        if not 0.7 < ratio < 1.4:
            raise MeshError(
                f"cap {cap.name} has {ratio:.2f} times the area of its vessel: "
                "it touches another vessel, or the centreline bends there"
            )
    return found
