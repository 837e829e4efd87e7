"""Shape of tetrahedra."""

import numpy as np

FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Faces of a positively oriented tetrahedron, outward."""

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def volumes(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return the signed volumes (m,) of tetrahedra (m, 4), cm3."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def radius_ratio(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return 3 × inscribed over circumscribed radius (m,): 1 if regular, 0 if flat, negative if inverted."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    u, v, w = b - a, c - a, d - a
    volume = np.einsum("ij,ij->i", np.cross(u, v), w) / 6.0
    area = sum(
        0.5
        * np.linalg.norm(
            np.cross(points[tets[:, f[1]]] - points[tets[:, f[0]]], points[tets[:, f[2]]] - points[tets[:, f[0]]]),
            axis=1,
        )
        for f in FACES
    )
    # Circumradius from the products of opposite edges (Crelle): 24 V R = sqrt((s)(s-2x)(s-2y)(s-2z))
    x = np.linalg.norm(u, axis=1) * np.linalg.norm(d - c, axis=1)
    y = np.linalg.norm(v, axis=1) * np.linalg.norm(d - b, axis=1)
    z = np.linalg.norm(w, axis=1) * np.linalg.norm(c - b, axis=1)
    heron = np.sqrt(np.maximum((x + y + z) * (y + z - x) * (x + z - y) * (x + y - z), 1e-300))
    return 3.0 * (3.0 * volume / area) * 24.0 * np.abs(volume) / heron


def dihedral_angles(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return the six inner dihedral angles of every tetrahedron (m, 6), degrees."""
    normals = []
    for f in FACES:
        normal = np.cross(points[tets[:, f[1]]] - points[tets[:, f[0]]], points[tets[:, f[2]]] - points[tets[:, f[0]]])
        normals.append(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])
    cosines = [np.einsum("ij,ij->i", normals[i], normals[j]) for i, j in EDGES]
    return 180.0 - np.degrees(np.arccos(np.clip(np.column_stack(cosines), -1.0, 1.0)))


def boundary(tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return outward boundary triangles (k, 3) of positive tetrahedra, and the tetrahedron (k,) behind each."""
    triangles = tets[:, FACES].reshape(-1, 3)
    owner = np.repeat(np.arange(len(tets)), 4)
    ordered = np.sort(triangles, axis=1)
    _, first, count = np.unique(ordered, axis=0, return_index=True, return_counts=True)
    if count.max(initial=0) > 2:
        raise ValueError("a face belongs to more than two tetrahedra")
    outer = np.sort(first[count == 1])
    return triangles[outer], owner[outer]


def areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the vector area (k, 3) of triangles, cm2."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def edge_lengths(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the mean edge length of every triangle or tetrahedron (m,), cm."""
    pairs = [(i, j) for i in range(cells.shape[1]) for j in range(i)]
    return np.mean([np.linalg.norm(points[cells[:, i]] - points[cells[:, j]], axis=1) for i, j in pairs], axis=0)


def altitudes(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return the smallest altitude of every tetrahedron (m,), cm."""
    largest = np.max([np.linalg.norm(areas(points, tets[:, face]), axis=1) for face in FACES], axis=0)
    return 3.0 * np.abs(volumes(points, tets)) / largest


def summary(points: np.ndarray, tets: np.ndarray) -> dict[str, float]:
    """Return volume (cm3), smallest and mean radius ratio, and smallest dihedral angle (degrees)."""
    ratio = radius_ratio(points, tets)
    return {
        "volume": float(volumes(points, tets).sum()),
        "radius_ratio_min": float(ratio.min()),
        "radius_ratio_mean": float(ratio.mean()),
        "dihedral_min": float(dihedral_angles(points, tets).min()),
    }
