"""Mesh the patient's own lumen: a closed surface, or a mesh-complete folder taken as it is."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.surface import Surface
from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.description import MeshDescription
from coronaryuq.flow3d.mesh.generation import folder, mmg_process
from coronaryuq.flow3d.mesh.generation.build import Built, assemble
from coronaryuq.flow3d.mesh.generation.piece import mesh_closed
from coronaryuq.flow3d.mesh.geometry import extent, paths
from coronaryuq.flow3d.mesh.geometry.grading import Grading
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit
from coronaryuq.flow3d.mesh.geometry.lumen import simplified
from coronaryuq.flow3d.mesh.geometry.paths import Cap, Size
from coronaryuq.flow3d.mesh.make_description import describe
from coronaryuq.flow3d.mesh.settings import Settings

SHORTEST = 0.01
"""Edges of a surface shorter than this fraction of the smallest radius are removed."""


def adopt_folder(
    mesh_folder: Path,
    tree: Tree,
    stenoses: Sequence[Stenosis],
    network: Network,
    settings: Settings,
    scale: float = 1.0,
) -> tuple[folder.Mesh, MeshDescription]:
    """Read a mesh-complete folder and describe it; faces keep their names and numbers.

    scale: the folder's length unit in cm. The tree must be that of the same anatomy: raises `InputError` if a cap has
    no vessel end near it, or an end no cap.
    """
    mesh = folder.read(mesh_folder)
    mesh = replace(mesh, points=mesh.points * scale)
    ends = [
        (name, np.array(face["centroid"]), np.array(face["normal"]), face["radius"])
        for number, name in mesh.caps.items()
        for face in [folder.face_geometry(mesh, number)]
    ]
    kept, caps = match(mesh_folder, tree, ends)
    return _described(mesh, kept, caps, tree, stenoses, network, settings, "given", [])


def mesh_closed_surface(
    surface: Surface, tree: Tree, stenoses: Sequence[Stenosis], network: Network, settings: Settings, file: Path
) -> tuple[folder.Mesh, MeshDescription]:
    """Fill a closed surface with tetrahedra sized by the tree's radii; raise `MeshError` if all attempts fail.

    The lumen is cut slightly behind each of its caps, so that the cut is flat and its rim clean.
    """
    flat = _at_vessel_ends(surface, tree)
    kept, caps = match(file, tree, [(f"cap{k}", cap.centre, cap.normal, cap.radius) for k, cap in enumerate(flat)])
    caps = [replace(cap, name=f"{'inlet' if cap.inlet else 'outlet'}_{cap.vessel}") for cap in caps]
    along = Implicit([path for piece in extent.pieces(tree, kept) for path in paths.paths(tree, kept, piece)])
    smallest = min(float(path.radii.min()) for path in along.paths)
    arguments = {
        "points": surface.points,
        "triangles": surface.triangles,
        "faces": [cap.faces for cap in flat],
        "implicit": simplified(surface.points, surface.triangles, SHORTEST * smallest),
        "caps": caps,
        "size": Size(along, stenoses, settings),
        "radius": smallest,
        "gradation": settings.gradation,
        "grading": Grading(along, stenoses, settings.wall_grading),
    }
    piece, failures = mmg_process.run(file.name, (mesh_closed, arguments), settings.time_limit, settings.attempts)
    mesh = assemble([piece], [[cap.name for cap in caps]])
    return _described(mesh, kept, caps, tree, stenoses, network, settings, "surface", failures)


def _at_vessel_ends(surface: Surface, tree: Tree) -> list:
    """Return the flat parts of a surface that lie at a vessel's end; others are facets of a coarse wall."""
    leaves = [(leaf.points[-1], leaf.radii[-1]) for leaf in tree.leaves()]
    ostia = [v for v in tree if tree.ostial(v)]
    at = [(v.position_at(extent.ostium(tree, v.name)), v.radii[0]) for v in ostia]
    chosen = set()
    for point, radius in [*leaves, (tree.root.points[0], tree.root.radii[0]), *at]:
        distance = [float(np.linalg.norm(cap.centre - point)) / max(cap.radius, radius) for cap in surface.caps]
        if min(distance) < 3.0:
            chosen.add(int(np.argmin(distance)))
    return [surface.caps[k] for k in sorted(chosen)]


def match(file: Path, tree: Tree, ends: Sequence[tuple[str, np.ndarray, np.ndarray, float]]) -> tuple[dict, list[Cap]]:
    """Match a lumen's ends (name, centre, outward normal, radius) to the tree; return the stretches kept and the caps.

    With a cap at the tree's root the lumen is the whole tree; otherwise it is the coronary trees from their ostia. Caps
    are in the order of the ends.
    """
    starts = {tree.root.name: tree.root.points[0]}
    rooted = any(np.linalg.norm(centre - starts[tree.root.name]) < 2.0 * radius for _, centre, _, radius in ends)
    kept = extent.whole(tree) if rooted else extent.trees(tree)
    places = [
        place for piece in extent.pieces(tree, kept) for place in paths.caps(tree, kept, piece)
    ]  # fmt: skip
    matched: dict[str, Cap] = {}
    caps = []
    for name, centre, normal, radius in ends:
        nearest = min(places, key=lambda place: float(np.linalg.norm(place.centre - centre)))
        away = float(np.linalg.norm(nearest.centre - centre))
        if away > 3.0 * max(radius, nearest.radius):
            raise InputError(
                file, name, None, f"no vessel of the tree ends here ({away:.2f} cm away is {nearest.name})"
            )
        if nearest.name in matched:
            raise InputError(file, name, None, f"is at the same vessel end as {matched[nearest.name].name}")
        cap = replace(nearest, name=name, centre=centre, normal=normal, radius=float(radius))
        matched[nearest.name] = cap
        caps.append(cap)
    for place in places:
        if place.name not in matched:
            raise InputError(file, "caps", None, f"no cap at {place.name} of the tree; cut the vessel flat there")
    return kept, caps


def _described(mesh, kept, caps, tree, stenoses, network, settings, domain: str, failures: list[str]):
    pieces = extent.pieces(tree, kept)
    surfaces = [Implicit(paths.paths(tree, kept, piece)) for piece in pieces]
    built = Built(mesh, kept, caps, pieces, surfaces, failures)
    return describe(tree, stenoses, network, built, settings, domain)
