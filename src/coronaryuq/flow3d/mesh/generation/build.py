"""From a centreline tree to one mesh of all pieces with named faces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.flow3d.mesh.generation import mmg_process, quality
from coronaryuq.flow3d.mesh.generation.folder import WALL, Mesh
from coronaryuq.flow3d.mesh.generation.piece import Piece, mesh_implicit
from coronaryuq.flow3d.mesh.geometry import extent, paths
from coronaryuq.flow3d.mesh.geometry.extent import Kept
from coronaryuq.flow3d.mesh.geometry.grading import Grading
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit
from coronaryuq.flow3d.mesh.geometry.paths import Cap, Size
from coronaryuq.flow3d.mesh.settings import Settings


@dataclass(frozen=True)
class Built:
    """A mesh and what it was made from.

    caps: in the order of their ModelFaceIDs, 2, 3, ...; pieces: vessels of each; implicit: surface of each piece;
    failures: one line per meshing attempt that failed before one succeeded.
    """

    mesh: Mesh
    kept: Kept
    caps: list[Cap]
    pieces: list[list[str]]
    implicit: list[Implicit]
    failures: list[str]


def kept_vessels(tree: Tree, stenoses: Sequence[Stenosis], settings: Settings) -> Kept:
    """Return the stretch of every vessel that the chosen domain keeps."""
    if settings.domain == "whole":
        return extent.whole(tree)
    if settings.domain == "trees":
        return extent.trees(tree)
    return extent.segments(
        tree, stenoses, settings.upstream_diameters, settings.downstream_diameters, settings.stub_diameters
    )


def build(tree: Tree, stenoses: Sequence[Stenosis], settings: Settings) -> Built:
    """Mesh the chosen domain, each piece in a process of its own; raise `MeshError` if a piece fails all attempts."""
    return build_kept(tree, kept_vessels(tree, stenoses, settings), stenoses, settings)


def build_kept(tree: Tree, kept: Kept, stenoses: Sequence[Stenosis], settings: Settings) -> Built:
    """Mesh the given stretches of vessels; as `build`."""
    groups = extent.pieces(tree, kept)
    pieces: list[Piece] = []
    surfaces: list[Implicit] = []
    caps: list[list[Cap]] = []
    failures: list[str] = []
    for group in groups:
        along = paths.paths(tree, kept, group)
        surface = Implicit(along)
        ends = paths.caps(tree, kept, group)
        arguments = {
            "implicit": surface,
            "caps": ends,
            "size": Size(surface, stenoses, settings),
            "radius": min(float(path.radii.min()) for path in along),
            "gradation": settings.gradation,
            "grading": Grading(surface, stenoses, settings.wall_grading),
        }
        piece, failed = mmg_process.run(group[0], (mesh_implicit, arguments), settings.time_limit, settings.attempts)
        pieces.append(piece)
        surfaces.append(surface)
        caps.append(ends)
        failures += [f"{group[0]}: {line}" for line in failed]
    mesh = assemble(pieces, [[cap.name for cap in group] for group in caps])
    return Built(mesh, kept, [cap for group in caps for cap in group], groups, surfaces, failures)


def assemble(pieces: Sequence[Piece], caps: Sequence[Sequence[str]]) -> Mesh:
    """Join pieces into one mesh with a single wall (ModelFaceID 1) and caps from 2 on; nodes are renumbered."""
    points = np.vstack([piece.points for piece in pieces])
    first = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    tets = np.vstack([piece.tets + shift for piece, shift in zip(pieces, first, strict=False)])
    outer = np.vstack([piece.triangles + shift for piece, shift in zip(pieces, first, strict=False)])
    before = np.cumsum([0, *(len(group) for group in caps)])
    face = np.concatenate(
        [np.where(piece.refs == 1, 1, piece.refs + shift) for piece, shift in zip(pieces, before, strict=False)]
    )
    names = {1: WALL} | dict(enumerate((n for group in caps for n in group), start=2))
    order = cuthill_mckee(tets, len(points))
    new = np.empty(len(points), np.int64)
    new[order] = np.arange(len(points))
    tets = new[tets]
    tets = tets[np.lexsort(np.sort(tets, axis=1).T[::-1])]
    face_of = {
        tuple(key): number for key, number in zip(np.sort(new[outer], axis=1).tolist(), face.tolist(), strict=True)
    }
    triangles, owner = quality.boundary(tets)
    face = np.array([face_of[tuple(key)] for key in np.sort(triangles, axis=1).tolist()])
    return Mesh(points[order], tets, triangles, owner, face, names, np.zeros(len(face), np.int64))


def cuthill_mckee(tets: np.ndarray, nodes: int) -> np.ndarray:
    """Return the reverse Cuthill-McKee order (nodes,): the i-th node of the new numbering."""
    from scipy.sparse import coo_array, csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    i, j = np.concatenate([tets[:, pair] for pair in quality.EDGES]).T
    graph = coo_array((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])), shape=(nodes, nodes))
    return np.asarray(reverse_cuthill_mckee(csr_matrix(graph), symmetric_mode=True), np.int64)
