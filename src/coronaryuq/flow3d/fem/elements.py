"""Linear tetrahedra: gradients, boundary faces and the sparse operators that every sample shares."""

import numpy as np
import scipy.sparse as sp

from coronaryuq.core.errors import InputError


def oriented(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return tetrahedra (m, 4) renumbered where needed so that every volume is positive."""
    edges = points[tets[:, 1:]] - points[tets[:, :1]]
    tets = tets.copy()
    negative = np.linalg.det(edges) < 0
    tets[negative] = tets[negative][:, [0, 2, 1, 3]]
    return tets


def gradients(points: np.ndarray, tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the volumes (m,) in cm3 and the hat functions' gradients (m, 4, 3) in 1/cm of tetrahedra (m, 4)."""
    edges = points[tets[:, 1:]] - points[tets[:, :1]]
    volume = np.linalg.det(edges) / 6.0
    if not (volume > 0).all():
        raise InputError("mesh", "tetrahedra", int((volume <= 0).sum()), "have no volume; mesh the geometry again")
    inverse = np.linalg.inv(edges)
    grad = np.empty((len(tets), 4, 3))
    grad[:, 1:] = inverse.transpose(0, 2, 1)
    grad[:, 0] = -grad[:, 1:].sum(axis=1)
    return volume, grad


def boundary_faces(tets: np.ndarray) -> np.ndarray:
    """Return the triangles (k, 3) of one tetrahedron only; normals are outward for positive tetrahedra."""
    faces = np.vstack([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]], tets[:, [0, 1, 3]], tets[:, [0, 2, 1]]])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def face_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return area times outward normal (k, 3) of triangles, in cm2."""
    corner = points[faces]
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2.0


def assemble(tets: np.ndarray, local: np.ndarray, nodes: int) -> sp.csr_matrix:
    """Return the sparse (n, n) matrix of element matrices (m, 4, 4), with explicit zeros so that patterns agree."""
    rows = np.repeat(tets, 4, axis=1).ravel()
    columns = np.tile(tets, (1, 4)).ravel()
    return sp.csr_matrix((local.ravel(), (rows, columns)), shape=(nodes, nodes))


def laplacian(tets: np.ndarray, volume: np.ndarray, grad: np.ndarray, nodes: int, weight=1.0) -> sp.csr_matrix:
    """Return ∫ w ∇N_i·∇N_j with `weight` a scalar or one value per tetrahedron."""
    return assemble(tets, np.einsum("e,eik,ejk->eij", volume * weight, grad, grad), nodes)


def gradient_operators(tets: np.ndarray, volume: np.ndarray, grad: np.ndarray, nodes: int) -> list[sp.csr_matrix]:
    """Return three matrices ∫ N_i ∂N_j/∂x_k, all with the pattern of `laplacian`."""
    quarter = volume[:, None] / 4.0
    return [
        assemble(tets, np.broadcast_to((quarter * grad[:, :, k])[:, None, :], (len(tets), 4, 4)), nodes)
        for k in range(3)
    ]


def lumped_mass(tets: np.ndarray, volume: np.ndarray, nodes: int) -> np.ndarray:
    """Return the row sums (n,) of the mass matrix, cm3."""
    return np.bincount(tets.ravel(), np.repeat(volume / 4.0, 4), nodes)
