"""Cut a closed triangulated surface flat slightly behind each of its caps, keeping its own triangles elsewhere."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.paths import Cap
from coronaryuq.flow3d.mesh.geometry.surface import WALL

INSET = 0.05
"""Distance of the cut behind the cap, in its radii: far enough for a wall nearly parallel to the cap."""

SIDES = 48
"""Sides of the prism that cuts off a cap."""


def trimmed(
    points: np.ndarray, triangles: np.ndarray, faces: Sequence[np.ndarray], caps: Sequence[Cap], tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (n, 3), outward triangles (m, 3) and references (m,) of the surface without its ends.

    faces: the triangles of each cap; tolerance: shorter edges are removed, cm. A Boolean difference, so that walls
    which touch or cut themselves at a cap do not matter. Raises `MeshError` if the surface is not closed and manifold.
    """
    import manifold3d

    solid = manifold3d.Manifold(manifold3d.Mesh64(points.astype(float), triangles.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError:
        raise MeshError(f"the surface is not closed and manifold ({solid.status().name})")
    reference = {}
    for number, (cap, own) in enumerate(zip(caps, faces, strict=True), start=WALL + 1):
        offset = points[np.unique(triangles[own])] - cap.centre
        height = offset @ cap.normal
        reach = np.linalg.norm(offset - height[:, None] * cap.normal, axis=1).max()
        depth = INSET * cap.radius
        knife = manifold3d.Manifold.cylinder(height.max() + 2.0 * depth, reach + 2.0 * depth, circular_segments=SIDES)
        across = np.linalg.svd(cap.normal[None])[2][1]
        frame = [across, np.cross(cap.normal, across), cap.normal, cap.centre - depth * cap.normal]
        knife = knife.transform(np.column_stack(frame)).as_original()
        reference[knife.original_id()] = number
        solid = solid - knife
    parts = solid.decompose()
    if not parts:
        raise MeshError("the surface encloses no volume between its caps")
    mesh = max(parts, key=lambda part: part.volume()).simplify(tolerance).to_mesh64()
    runs = np.diff(np.asarray(mesh.run_index)) // 3
    refs = np.repeat([reference.get(int(original), WALL) for original in mesh.run_original_id], runs)
    # Corners shared by runs are listed once per run: merge them.
    merged = np.arange(len(mesh.vert_properties))
    merged[np.asarray(mesh.merge_from_vert, np.int64)] = np.asarray(mesh.merge_to_vert, np.int64)
    used, corners = np.unique(merged[np.asarray(mesh.tri_verts, np.int64)], return_inverse=True)
    return np.asarray(mesh.vert_properties[:, :3], float)[used], corners.reshape(-1, 3), refs
