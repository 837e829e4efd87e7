"""Move the nodes of a mesh to a drawn lumen: with the wall on the surface, harmonically inside.

A harmonic displacement is linear in a tube whose radius changes by one factor, so that there every element only shrinks
or grows across the vessel, and it has no extremes inside. Its matrix is factored once per mesh.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.lumen.profiles import Lumen
from coronaryuq.flow3d.mesh.generation import quality
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.morph.surface import displacement, forks, surface_moves
from coronaryuq.flow3d.mesh.read_mesh import Domain

FLATTEST = 1.0
"""Degrees; smallest dihedral angle of a drawn lumen's elements, which flatten as it shrinks."""


@dataclass(frozen=True)
class Moved:
    """Nodes (n, 3) cm of a drawn lumen, and the quality of their elements."""

    points: np.ndarray
    quality: dict[str, float]


class Morph:
    """The nodes of one mesh as a function of the lumen's coordinates.

    Parameters
    ----------
    domain
        The mesh of the segmented lumen.
    tree
        The segmented lumen.
    lumen
        Its law.
    """

    def __init__(self, domain: Domain, tree: Tree, lumen: Lumen):
        self.domain, self.lumen = domain, lumen
        kept = {name: interval for piece in domain.description.pieces for name, interval in piece.items()}
        triangles, _ = quality.boundary(domain.tets)
        self._surface = np.unique(triangles)
        self._moves = surface_moves(tree, kept, domain.points, self._surface)
        self._forks = forks(tree, kept)
        self._caps = [
            (np.unique(faces), _unit(quality.areas(domain.points, faces).sum(axis=0))) for faces in domain.caps.values()
        ]
        self._inner = np.setdiff1d(np.arange(len(domain.points)), self._surface)
        matrix = _stiffness(domain.points, domain.tets)
        self._edge = matrix[self._inner][:, self._surface]
        self._factor = splu(sp.csc_matrix(matrix[self._inner][:, self._inner])) if len(self._inner) else None
        self._least = min(FLATTEST, 0.5 * quality.dihedral_angles(domain.points, domain.tets).min())

    def __call__(self, z: Mapping[str, float]) -> Moved:
        """Return the nodes of one draw.

        Parameters
        ----------
        z
            Coordinates of the lumen's law; absent ones are at their centre, zero.

        Raises
        ------
        MeshError
            An element would be inverted, or flatter than `FLATTEST` and than half the mesh's flattest.
        """
        one = {name: np.array([value]) for name, value in z.items() if name in self.lumen.names}
        fork_ratio = {
            name: sum(weight * float(self.lumen.ratio(v, arc, one)[0, 0]) for v, (arc, weight) in fork.ends.items())
            for name, fork in self._forks.items()
        }
        shift = displacement(
            self._moves, lambda name, arc: self.lumen.ratio(name, arc, one)[0], fork_ratio, len(self.domain.points)
        )
        for nodes, normal in self._caps:  # caps stay in their planes
            shift[nodes] -= (shift[nodes] @ normal)[:, None] * normal
        if self._factor is not None:
            shift[self._inner] = -self._factor.solve(self._edge @ shift[self._surface])
        points = self.domain.points + shift
        return Moved(points, self._checked(points))

    def _checked(self, points: np.ndarray) -> dict[str, float]:
        tets = self.domain.tets
        volume = quality.volumes(points, tets)
        if volume.min() <= 0.0:
            raise MeshError(f"the drawn lumen inverts {int((volume <= 0.0).sum())} tetrahedra")
        angles = quality.dihedral_angles(points, tets)
        if angles.min() < self._least:
            raise MeshError(f"the drawn lumen flattens tetrahedra to {angles.min():.2g} degrees")
        ratio = quality.radius_ratio(points, tets)
        return {
            "volume": float(volume.sum()),
            "radius_ratio_min": float(ratio.min()),
            "radius_ratio_mean": float(ratio.mean()),
            "dihedral_min": float(angles.min()),
        }


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _stiffness(points: np.ndarray, tets: np.ndarray) -> sp.csr_matrix:
    """Return ∫∇N_i·∇N_j, (n, n)."""
    volume = quality.volumes(points, tets)
    outward = np.stack([quality.areas(points, tets[:, face]) for face in quality.FACES], axis=1)
    grad = -outward / (3.0 * volume)[:, None, None]
    local = np.einsum("e,eik,ejk->eij", volume, grad, grad)
    rows, columns = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()
    return sp.csr_matrix((local.ravel(), (rows, columns)), shape=(len(points), len(points)))
