"""Structured tetrahedral meshes of straight tubes with any radius along the axis, for verification."""

from collections.abc import Callable

import numpy as np

from coronaryuq.flow3d.fem.elements import boundary_faces, oriented


def disc(rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit disc of concentric rings of 6, 12, 18... points: points (n, 2), triangles (m, 3)."""
    points, start = [(0.0, 0.0)], [0]
    for ring in range(1, rings + 1):
        start.append(len(points))
        angle = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        points += list(zip(np.cos(angle) * ring / rings, np.sin(angle) * ring / rings, strict=True))
    triangles = []
    for ring in range(1, rings + 1):
        inner, outer = max(6 * (ring - 1), 1), 6 * ring
        for sector in range(6):
            for k in range(ring):
                a = start[ring] + (sector * ring + k) % outer
                b = start[ring] + (sector * ring + k + 1) % outer
                c = start[ring - 1] + (sector * (ring - 1) + k) % inner
                triangles.append((a, b, c))
                if k < ring - 1:
                    d = start[ring - 1] + (sector * (ring - 1) + k + 1) % inner
                    triangles.append((c, b, d))
    return np.array(points), np.array(triangles)


def tube(
    length: float, radius: Callable[[np.ndarray], np.ndarray] | float, rings: int, z: np.ndarray | int
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return a mesh of a tube along +z.

    Parameters
    ----------
    length
        cm.
    radius
        cm, a number or a function of z.
    rings
        Cells from axis to wall.
    z
        Number of cells along the axis, or the levels themselves (cm, increasing).

    Returns
    -------
    tuple
        Points (n, 3) in cm, tetrahedra (m, 4), and the triangles of `inlet`, `outlet` and `wall`.
    """
    plane, triangles = disc(rings)
    levels = np.linspace(0.0, length, z + 1) if isinstance(z, int) else np.asarray(z, float)
    radii = np.broadcast_to(radius(levels) if callable(radius) else radius, levels.shape)
    n = len(plane)
    points = np.concatenate([np.c_[plane * r, np.full(n, at)] for at, r in zip(levels, radii, strict=True)])
    triangles = np.sort(triangles, axis=1)
    cells = []
    for level in range(len(levels) - 1):
        low, high = triangles + level * n, triangles + (level + 1) * n
        a, b, c = low.T
        d, e, f = high.T
        cells += [np.c_[a, b, c, f], np.c_[a, b, f, e], np.c_[a, e, f, d]]
    tets = oriented(points, np.concatenate(cells))
    faces = boundary_faces(tets)
    at = points[faces][:, :, 2]
    inlet, outlet = (at == levels[0]).all(axis=1), (at == levels[-1]).all(axis=1)
    return points, tets, {"inlet": faces[inlet], "outlet": faces[outlet], "wall": faces[~inlet & ~outlet]}
