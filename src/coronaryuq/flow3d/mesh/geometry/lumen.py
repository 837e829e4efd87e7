"""A closed triangulated lumen as an implicit surface, so that even a rough or self-touching one can be meshed."""

from collections.abc import Iterator

import numpy as np

AT_ONCE = 256
"""Number of blocks processed together: more need much memory, fewer rebuild the search tree too often."""


class Lumen:
    """Signed distance, negative inside, to a closed surface: points (n, 3) cm, outward triangles (m, 3).

    The sign is that of the angle-weighted normal at the nearest point, in a triangle, on an edge or at a corner
    (Baerentzen & Aanaes 2005): the plain mean of the normals around a corner fails beside the rim of a cap.
    """

    def __init__(self, points: np.ndarray, triangles: np.ndarray):
        self.points, self.triangles = points, triangles
        corner = points[triangles]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        self._at_corner = np.zeros_like(points)
        for k in range(3):
            a, b = corner[:, (k + 1) % 3] - corner[:, k], corner[:, (k + 2) % 3] - corner[:, k]
            angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
            np.add.at(self._at_corner, triangles[:, k], angle[:, None] * self._normal)
        edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        _, edge = np.unique(edges, axis=0, return_inverse=True)
        sums = np.zeros((edge.max() + 1, 3))
        np.add.at(sums, edge.ravel(), np.repeat(self._normal, 3, axis=0))
        self._at_edge = sums[edge.ravel()].reshape(-1, 3, 3)

    def _nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the triangle (m,) and the point on it (m, 3) nearest to each point."""
        import pyvista as pv

        if not len(points):
            return np.empty(0, np.int64), np.empty((0, 3))
        surface = pv.PolyData.from_regular_faces(self.points, self.triangles)
        triangle, place = surface.find_closest_cell(np.asarray(points, float), return_closest_point=True)
        return np.atleast_1d(triangle), np.asarray(place, float).reshape(-1, 3)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance (m,) at points (m, 3), cm."""
        triangle, place = self._nearest(points)
        corner = self.points[self.triangles[triangle]]
        normal = self._normal[triangle]
        # Shares of the corners opposite to edges (1, 2), (2, 0), (0, 1) in the nearest point.
        opposite = [
            np.cross(corner[:, (k + 2) % 3] - corner[:, (k + 1) % 3], place - corner[:, (k + 1) % 3]) for k in range(3)
        ]
        share = np.stack([(part * normal).sum(axis=1) for part in opposite], axis=1)
        absent = share < 1e-6 * share.sum(axis=1, keepdims=True)
        on_edge, on_corner = absent.sum(axis=1) == 1, absent.sum(axis=1) >= 2
        normal[on_edge] = self._at_edge[triangle[on_edge], (np.argmax(absent[on_edge], axis=1) + 1) % 3]
        nearest = np.argmax(share, axis=1)
        normal[on_corner] = self._at_corner[self.triangles[triangle[on_corner], nearest[on_corner]]]
        off = np.asarray(points) - place
        return np.linalg.norm(off, axis=1) * np.where((off * normal).sum(axis=1) < 0.0, -1.0, 1.0)

    def gradient(self, points: np.ndarray, step: float) -> np.ndarray:
        """Return central differences of the distance, (m, 3)."""
        shifts = np.concatenate([step * np.eye(3), -step * np.eye(3)])
        values = self.distance((points + shifts[:, None]).reshape(-1, 3)).reshape(6, -1)
        return (values[:3] - values[3:]).T / (2.0 * step)

    def project(self, points: np.ndarray, step: float, iterations: int = 1) -> np.ndarray:
        """Return the nearest points on the surface, (m, 3), found directly: `step` and `iterations` are not needed."""
        return self._nearest(points)[1]

    def blocks(self, spacing: float, cells: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the cubes that the surface may cross; see `SignedDistance.blocks`."""
        low = self.origin(spacing)
        count = np.ceil((self.points.max(axis=0) + 3.0 * spacing - low) / (cells * spacing)).astype(int)
        corners = cells * np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 3)
        reach = 0.5 * np.sqrt(3.0) * cells * spacing
        crossed = np.abs(self.distance(low + spacing * (corners + 0.5 * cells))) < reach
        steps = np.stack(np.meshgrid(*[np.arange(cells + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        corners = corners[crossed]
        for first in range(0, len(corners), AT_ONCE):
            part = corners[first : first + AT_ONCE]
            values = self.distance((low + spacing * (part[:, None] + steps)).reshape(-1, 3))
            yield from zip(part, values.reshape(len(part), *[cells + 1] * 3), strict=True)

    def origin(self, spacing: float) -> np.ndarray:
        """Return the lower corner of the grid (3,), cm."""
        # Not a multiple of the spacing: a flat end would lie in a grid plane, where the distance has no sign.
        return self.points.min(axis=0) - 3.37 * spacing


def simplified(points: np.ndarray, triangles: np.ndarray, tolerance: float) -> Lumen:
    """Return the lumen without slivers and edges shorter than `tolerance` (cm), whose normals are meaningless.

    A surface that is not closed and manifold stays as it is.
    """
    import manifold3d

    solid = manifold3d.Manifold(manifold3d.Mesh(points.astype(np.float32), triangles.astype(np.uint32)))
    if solid.status() != manifold3d.Error.NoError:
        return Lumen(points, triangles)
    mesh = solid.simplify(tolerance).to_mesh()
    return Lumen(np.asarray(mesh.vert_properties[:, :3], float), np.asarray(mesh.tri_verts, np.int64))
