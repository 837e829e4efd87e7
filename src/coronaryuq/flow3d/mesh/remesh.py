"""A drawn lumen meshed anew, as the segmented one was: for a draw that the segmented lumen's nodes cannot follow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.case.lumen.profiles import Lumen
from coronaryuq.flow3d.mesh.description import Face, MeshDescription, Region
from coronaryuq.flow3d.mesh.generation import folder, quality, regions
from coronaryuq.flow3d.mesh.generation.build import build_kept
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.read_mesh import Domain, domain_of
from coronaryuq.flow3d.mesh.settings import Settings

TIME_LIMIT = 180.0
"""CPU seconds for each piece of one sample's mesh, in one attempt: with more, one draw could hold up its batch for
hours."""
NO_TREE = "the mesh is not made from centrelines and radii, so that a drawn lumen cannot be meshed"


@dataclass(frozen=True)
class Remeshed:
    """The mesh of a drawn lumen, as a folder holds it and as a solver uses it, and the quality of its elements."""

    mesh: folder.Mesh
    domain: Domain
    quality: dict[str, float]


class Remesher:
    """The mesh of a drawn lumen as a function of the law's coordinates.

    It ends where the mesh of the segmented lumen does and has its planes and the same stretches of wall as regions, so
    that quantities mean the same and the 0D side stays as it is.

    Parameters
    ----------
    domain
        The mesh of the segmented lumen.
    tree
        The segmented lumen.
    stenoses
        Its stenoses, which the mesh resolves.
    lumen
        The law of the drawn ones.
    """

    def __init__(self, domain: Domain, tree: Tree, stenoses: Sequence[Stenosis], lumen: Lumen):
        self.description, self.tree, self.stenoses, self.lumen = domain.description, tree, stenoses, lumen

    def __call__(self, z: Mapping[str, float]) -> Remeshed:
        """Return the mesh of one draw.

        Parameters
        ----------
        z
            Coordinates of the lumen's law; absent ones are at their centre, zero.

        Raises
        ------
        MeshError
            The segmented lumen was not meshed from the tree, or the drawn one cannot be meshed.
        """
        if self.description.domain not in ("segments", "trees", "whole"):
            raise MeshError(NO_TREE)
        try:
            return self._meshed(drawn_tree(self.tree, self.lumen, z))
        except ValueError as error:  # of a lumen that is no tree, or a mesh without a region
            raise MeshError(str(error)) from None

    def _meshed(self, tree: Tree) -> Remeshed:
        old = self.description
        kept = {name: self._interval(tree[name], interval) for piece in old.pieces for name, interval in piece.items()}
        settings = Settings.model_validate(old.settings)
        bounded = settings.model_copy(update={"attempts": 1, "time_limit": min(settings.time_limit, TIME_LIMIT)})
        built = build_kept(tree, kept, self.stenoses, bounded)
        mesh, marked = regions.mark_again(old.regions, built)
        domain = domain_of(mesh, _described(old, mesh, marked, built.failures))
        return Remeshed(mesh, domain, quality.summary(mesh.points, mesh.tets))

    def _interval(self, drawn: Vessel, interval: tuple[float, float]) -> tuple[float, float]:
        """Return a kept interval, up to the drawn vessel's own end where it reaches the segmented one's.

        Further knots change the length of a vessel by rounding.
        """
        start, end = interval
        return start, drawn.length if end >= self.tree[drawn.name].length else end


def drawn_tree(tree: Tree, lumen: Lumen, z: Mapping[str, float]) -> Tree:
    """Return the tree with the radii of one draw, with additional points at the knots of the lumen's law."""
    one = {name: np.array([value]) for name, value in z.items() if name in lumen.names}
    drawn = []
    for vessel in tree:
        arc = np.clip(np.unique(np.concatenate([vessel.arc, *lumen.knots(vessel.name)])), 0.0, vessel.length)
        arc = arc[np.r_[True, np.diff(arc) > 1e-9]]
        radii = vessel.radius_at(arc) * lumen.ratio(vessel.name, arc, one)[0]
        drawn.append(replace(vessel, points=vessel.position_at(arc), radii=radii))
    return Tree(drawn)


def _described(
    old: MeshDescription, mesh: folder.Mesh, marked: dict[str, Region], failures: list[str]
) -> MeshDescription:
    """Return the description of the segmented lumen's mesh with the sizes of another one."""
    number = {name: k for k, name in mesh.names.items()}
    summary = quality.summary(mesh.points, mesh.tets)
    return old.model_copy(
        update={
            "nodes": len(mesh.points),
            "tets": len(mesh.tets),
            "volume": summary["volume"],
            "faces": [_resized(face, folder.face_geometry(mesh, number[face.name])) for face in old.faces],
            "regions": marked,
            "quality": summary,
            "failed_attempts": failures,
        }
    )


def _resized(face: Face, geometry: dict[str, Any]) -> Face:
    """Return a face with another geometry; of a wall, whose other sizes mean nothing, with another area."""
    known = face.model_dump(exclude_none=True)
    return Face.model_validate(known | {name: value for name, value in geometry.items() if name in known})
