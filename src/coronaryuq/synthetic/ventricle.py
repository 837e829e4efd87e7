"""The bundled patient's heart: a left ventricular wall between truncated ellipsoids, and the right ventricle.

Heart frame, cm: the origin is the centre of the left ventricle's base plane, x points to its lateral wall, y to its
inferior one and z to the atria; the apex lies at negative z. The angle φ runs round the long axis: 0 lateral,
90° anterior, 180° septal, 270° inferior.
"""

from dataclasses import dataclass, field

import numpy as np

ANTERIOR_GROOVE, POSTERIOR_GROOVE = np.radians(122.0), np.radians(243.0)
"""φ of the interventricular grooves, between which the septum lies."""


@dataclass(frozen=True)
class Ellipsoid:
    """Half ellipsoid of revolution about z, cut by the plane z = 0 at `cut` above its centre."""

    radius: float
    length: float
    cut: float

    def point(self, phi, s) -> np.ndarray:
        """Return the point (..., 3) at angle φ and longitudinal coordinate s: 0 at the base, 1 at the apex."""
        start = np.arccos(self.cut / self.length)
        polar = start + np.asarray(s) * (np.pi - start)
        ring = self.radius * np.sin(polar)
        phi, height = np.broadcast_arrays(phi, self.length * np.cos(polar) - self.cut)
        return np.stack([ring * np.cos(phi), -ring * np.sin(phi), height], axis=-1)

    @property
    def volume(self) -> float:
        """Volume below the base plane, cm3: π b² (2a/3 + h − h³/3a²)."""
        a, h = self.length, self.cut
        return np.pi * self.radius**2 * (2 * a / 3 + h - h**3 / (3 * a**2))


@dataclass(frozen=True)
class Ventricle:
    """A left ventricle at end-diastole: 6.6 cm wide outside, wall 0.8 to 1.0 cm thick, cavity 88 mL, wall 112 mL."""

    outer: Ellipsoid = field(default_factory=lambda: Ellipsoid(radius=3.3, length=6.0, cut=1.9))
    inner: Ellipsoid = field(default_factory=lambda: Ellipsoid(radius=2.3, length=5.2, cut=1.9))

    @property
    def wall_volume(self) -> float:
        """Exact volume of the wall, cm3."""
        return self.outer.volume - self.inner.volume

    def point(self, phi, s, depth) -> np.ndarray:
        """Return a point (..., 3) of the wall; depth 0 at the epicardium, 1 at the endocardium."""
        depth = np.asarray(depth)[..., None]
        return (1 - depth) * self.outer.point(phi, s) + depth * self.inner.point(phi, s)

    def coordinates(self, points: np.ndarray, sweeps: int = 30) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute φ in [0, 2π), s and depth of points (n, 3) in the wall: invert `point` by Newton's method."""
        phi = np.arctan2(-points[:, 1], points[:, 0]) % (2 * np.pi)
        ring, height = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        tip = -(self.outer.length + self.outer.cut)
        s, depth = np.clip(height / tip, 0.02, 0.98), np.full(len(points), 0.5)
        for _ in range(sweeps):
            here, step = self.point(0.0, s, depth), 1e-6
            by_s = (self.point(0.0, s + step, depth) - self.point(0.0, s - step, depth)) / (2 * step)
            by_depth = self.inner.point(0.0, s) - self.outer.point(0.0, s)
            off = np.stack([ring - here[:, 0], height - here[:, 2]])
            det = by_s[:, 0] * by_depth[:, 2] - by_s[:, 2] * by_depth[:, 0]
            s = s + np.clip((off[0] * by_depth[:, 2] - off[1] * by_depth[:, 0]) / det, -0.2, 0.2)
            depth = depth + np.clip((by_s[:, 0] * off[1] - by_s[:, 2] * off[0]) / det, -0.5, 0.5)
        return phi, s, depth

    def epicardium(self, phi, s) -> np.ndarray:
        """Return a point (..., 3) of the outer surface of both ventricles; the right one bulges over the septum."""
        phi, s = np.broadcast_arrays(np.asarray(phi, dtype=float), np.asarray(s, dtype=float))
        across = (phi % (2 * np.pi) - ANTERIOR_GROOVE) / (POSTERIOR_GROOVE - ANTERIOR_GROOVE)
        inside = np.where((across > 0) & (across < 1), np.sin(np.pi * np.clip(across, 0, 1)) ** 0.8, 0.0)
        bulge = 3.0 * inside * np.clip(1 - np.maximum(s, 0) / 0.9, 0, 1) ** 0.7
        point = self.outer.point(phi, s)
        return point + bulge[..., None] * np.stack([np.cos(phi), -np.sin(phi), np.zeros_like(phi)], axis=-1)

    def mesh(self, cells: int = 30_000):
        """Mesh the wall with about `cells` tetrahedra as a pyvista UnstructuredGrid, points in cm.

        A disc of rings (ring k has 6 k points) is laid on both surfaces and joined in layers of wedges, each cut into
        three tetrahedra along diagonals that start at the lower of two point numbers, so that neighbours match.
        """
        import pyvista as pv

        # Layers as thick as the rings are wide: 18 rings² layers = cells; the wall is 1 cm thick, its arc 11 cm long.
        rings = max(3, round((cells / 18 * 9) ** (1 / 3)))
        layers = max(2, round(cells / (18 * rings**2)))
        phi, s, triangles = _disc(rings)
        depths = np.linspace(0.0, 1.0, layers + 1)
        points = np.concatenate([self.point(phi, s, np.full(len(phi), d)) for d in depths])
        tetrahedra = _tetrahedra(triangles, len(phi), layers)
        a, b, c, d = (points[tetrahedra[:, k]] for k in range(4))
        inverted = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
        tetrahedra[inverted, 2:] = tetrahedra[inverted, :1:-1]
        return pv.UnstructuredGrid({pv.CellType.TETRA: tetrahedra}, points)


def _disc(rings: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return φ and s of a disc's points, from the apex to the base ring, and its triangles."""
    starts = [0] + [1 + 3 * k * (k - 1) for k in range(1, rings + 2)]
    phi = np.concatenate([[0.0]] + [2 * np.pi * np.arange(6 * k) / (6 * k) for k in range(1, rings + 1)])
    s = np.concatenate([[1.0]] + [np.full(6 * k, 1 - k / rings) for k in range(1, rings + 1)])
    triangles = []
    for k in range(1, rings + 1):
        outer, inner, n, m = starts[k], starts[k - 1], 6 * k, max(6 * (k - 1), 1)
        for sector in range(6):
            for j in range(k):
                here, after = outer + sector * k + j, outer + (sector * k + j + 1) % n
                below = inner + (sector * (k - 1) + j) % m
                triangles.append((here, after, below))
                if j < k - 1:
                    triangles.append((after, inner + (sector * (k - 1) + j + 1) % m, below))
    return phi, s, np.array(triangles)


def _tetrahedra(triangles: np.ndarray, stride: int, layers: int) -> np.ndarray:
    low = np.sort(triangles, axis=1)
    wedge = np.stack([low[:, 0], low[:, 1], low[:, 2]], axis=1)
    top = wedge + stride
    one_layer = np.concatenate(
        [
            np.column_stack([wedge, top[:, 2]]),
            np.column_stack([wedge[:, :2], top[:, 1:]]),
            np.column_stack([wedge[:, 0], top]),
        ]
    )
    return np.concatenate([one_layer + layer * stride for layer in range(layers)])
