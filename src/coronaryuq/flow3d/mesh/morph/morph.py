"""Move the nodes of a mesh to a drawn lumen: with the wall on the surface, harmonically inside.

A harmonic displacement is linear in a tube whose radius changes by one factor, so that there every element only shrinks
or grows across the vessel, and it has no extremes inside. Its matrix is factored once per mesh.

A draw that this spoils is moved again, in increments that each start from the lumen of the one before, with elements
the stiffer the smaller they are: those of a throat then keep their shape, and larger ones beside it give way.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.lumen.profiles import Lumen
from coronaryuq.flow3d.mesh.generation import quality
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.morph.surface import displacement, forks, surface_moves
from coronaryuq.flow3d.mesh.read_mesh import Domain

FLATTEST = 1.0
"""Degrees; smallest dihedral angle of a drawn lumen's elements, which flatten as it shrinks."""
INCREMENTS = 8
"""Of a draw that one displacement spoils; 16 keep hardly any draw more."""


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
        self._edge, self._factor = self._factored(_stiffness(domain.points, domain.tets))
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
            An element would be inverted, or flatter than `FLATTEST` and than half the mesh's flattest, in increments,
            too.
        """
        shift = self._surface_shift(z)
        try:
            return self._checked(self.domain.points + self._inside(shift, self._edge, self._factor))
        except MeshError:
            moved = self._checked(self._gradually(shift))
            return Moved(moved.points, moved.quality | {"increments": INCREMENTS})

    def _surface_shift(self, z: Mapping[str, float]) -> np.ndarray:
        """Return the displacement (n, 3) cm of the nodes on the surface, zero inside."""
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
        return shift

    def _factored(self, matrix: sp.csr_matrix) -> tuple[sp.csr_matrix, SuperLU | None]:
        """Return the columns of the surface, and the factor inside; None if no node lies there."""
        rows = matrix[self._inner]
        factor = splu(sp.csc_matrix(rows[:, self._inner])) if len(self._inner) else None
        return rows[:, self._surface], factor

    def _inside(self, shift: np.ndarray, edge: sp.csr_matrix, factor: SuperLU | None) -> np.ndarray:
        """Return the displacement with that of the inner nodes."""
        if factor is not None:
            shift[self._inner] = -factor.solve(edge @ shift[self._surface])
        return shift

    def _gradually(self, shift: np.ndarray) -> np.ndarray:
        """Return the nodes moved in increments; raise `MeshError` if one of them inverts an element."""
        points = self.domain.points
        for _ in range(INCREMENTS):
            _check_volumes(points, self.domain.tets)
            matrix = _stiffness(points, self.domain.tets, small_are_stiff=True)
            points = points + self._inside(shift / INCREMENTS, *self._factored(matrix))
        return points

    def _checked(self, points: np.ndarray) -> Moved:
        tets = self.domain.tets
        _check_volumes(points, tets)
        angle = quality.dihedral_angles(points, tets).min()
        if angle < self._least:
            raise MeshError(f"the drawn lumen flattens tetrahedra to {angle:.2g} degrees")
        return Moved(points, quality.summary(points, tets))


def _check_volumes(points: np.ndarray, tets: np.ndarray) -> None:
    inverted = int((quality.volumes(points, tets) <= 0.0).sum())
    if inverted:
        raise MeshError(f"the drawn lumen inverts {inverted} tetrahedra")


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _stiffness(points: np.ndarray, tets: np.ndarray, small_are_stiff: bool = False) -> sp.csr_matrix:
    """Return ∫∇N_i·∇N_j, (n, n), or the sum of its elements' means."""
    volume = quality.volumes(points, tets)
    outward = np.stack([quality.areas(points, tets[:, face]) for face in quality.FACES], axis=1)
    grad = -outward / (3.0 * volume)[:, None, None]
    weight = np.ones(len(tets)) if small_are_stiff else volume
    local = np.einsum("e,eik,ejk->eij", weight, grad, grad)
    rows, columns = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()
    return sp.csr_matrix((local.ravel(), (rows, columns)), shape=(len(points), len(points)))
