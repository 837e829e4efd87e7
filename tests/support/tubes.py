"""Closed surfaces of trees with flat ends, as segmentation software makes them."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import Tree, distance_to


def tube_surface(tree: Tree, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and triangles (m, 3) of the lumen of a tree, cut flat at its root's start and at every end."""
    manifold3d = pytest.importorskip("manifold3d")
    from skimage.measure import marching_cubes

    points = np.concatenate([v.points for v in tree])
    low = points.min(axis=0) - 2.0
    counts = np.ceil((points.max(axis=0) + 2.0 - low) / spacing).astype(int)
    field = np.full(counts, 3 * spacing)
    for vessel in tree:
        line = vessel.resampled(0.1)
        for k in range(len(line.points) - 1):
            part = line.between(line.arc[k], line.arc[k + 1])
            reach = part.radii.max() + 4 * spacing
            first = np.maximum(((part.points.min(axis=0) - reach - low) / spacing).astype(int), 0)
            last = np.minimum(((part.points.max(axis=0) + reach - low) / spacing).astype(int) + 2, counts)
            grid = np.stack(
                np.meshgrid(*(np.arange(a, b) for a, b in zip(first, last, strict=True)), indexing="ij"), -1
            )
            distance = distance_to(part, grid.reshape(-1, 3) * spacing + low).reshape(grid.shape[:-1])
            block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            field[block] = np.minimum(field[block], distance)
    vertices, triangles, _, _ = marching_cubes(field, 0.0, spacing=(spacing,) * 3)
    mesh = manifold3d.Mesh((vertices + low).astype(np.float32), triangles[:, ::-1].astype(np.uint32))
    solid = manifold3d.Manifold(mesh)
    root = tree.root
    ends = [(root.points[0], -root.tangent_at(0.0), root.radii[0])]
    ends += [(v.points[-1], v.tangent_at(v.length), v.radii[-1]) for v in tree.leaves()]
    for centre, along, radius in ends:
        x = np.cross(along, [1.0, 0, 0] if abs(along[0]) < 0.8 else [0, 1.0, 0])
        x /= np.linalg.norm(x)
        # The round end of the capsule beyond the vessel's end plane goes.
        cutter = manifold3d.Manifold.cylinder(3 * radius, 1.6 * radius, 1.6 * radius, 32)
        solid -= cutter.transform(np.column_stack([x, np.cross(along, x), along, centre]).tolist())
    mesh = solid.to_mesh()
    return np.asarray(mesh.vert_properties[:, :3], dtype=float), np.asarray(mesh.tri_verts, dtype=int)
