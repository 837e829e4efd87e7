"""Describe a finished mesh: the content of `mesh.json`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, throat
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.network import Network
from coronaryuq.flow3d.mesh.coupling.cap_connections import connect_caps
from coronaryuq.flow3d.mesh.description import Couples, Face, MeshDescription
from coronaryuq.flow3d.mesh.generation import quality, regions
from coronaryuq.flow3d.mesh.generation.build import Built
from coronaryuq.flow3d.mesh.generation.folder import Mesh, face_geometry
from coronaryuq.flow3d.mesh.settings import Settings


def describe(
    tree: Tree, stenoses: Sequence[Stenosis], network: Network, built: Built, settings: Settings, domain: str
) -> tuple[Mesh, MeshDescription]:
    """Return the mesh with its stenosis regions marked, and its description."""
    present = [s for s in stenoses if s.vessel in built.kept]
    mesh, marked = regions.mark(
        tree, present, built, settings.region_upstream_diameters, settings.region_downstream_diameters
    )
    connections = connect_caps(tree, built.kept, vessels_along(tree, present, network), network, built.caps)
    return mesh, MeshDescription(
        domain=domain,
        nodes=len(mesh.points),
        tets=len(mesh.tets),
        volume=float(quality.volumes(mesh.points, mesh.tets).sum()),
        pieces=[{name: built.kept[name] for name in group} for group in built.pieces],
        faces=faces(mesh, connections.caps),
        replaces=connections.replaces,
        cut=connections.cut,
        regions=marked,
        planes={s.name: regions.plane(tree, s, present, built, settings.ffr_diameters) for s in present},
        proximal_planes={s.name: regions.proximal_plane(tree, s, present, built) for s in present},
        quality=shape(mesh) | {"throat_resolution": {s.name: resolution(tree, s, mesh) for s in present}},
        failed_attempts=built.failures,
        settings=settings.model_dump(mode="json"),
    )


def faces(mesh: Mesh, couples: Mapping[str, Couples]) -> list[Face]:
    """Return one entry per face; caps carry what they couple."""
    entries = []
    for number, name in mesh.names.items():
        geometry = face_geometry(mesh, number)
        if number in mesh.caps:
            entries.append(Face(name=name, kind="cap", number=number, couples=couples[name], **geometry))
        else:
            entries.append(Face(name=name, kind="wall", number=number, area=geometry["area"]))
    return entries


def shape(mesh: Mesh) -> dict[str, Any]:
    """Return element quality: radius ratio (1 is regular), dihedral angles (degrees), smallest altitude (cm)."""
    ratio = quality.radius_ratio(mesh.points, mesh.tets)
    angles = quality.dihedral_angles(mesh.points, mesh.tets)
    return {
        "radius_ratio_min": float(ratio.min()),
        "radius_ratio_mean": float(ratio.mean()),
        "dihedral_min": float(angles.min()),
        "dihedral_max": float(angles.max()),
        "altitude_min": float(quality.altitudes(mesh.points, mesh.tets).min()),
        "tets_on_wall_only": int(np.isin(mesh.tets, mesh.triangles[mesh.wall_triangles()]).all(axis=1).sum()),
    }


def resolution(tree: Tree, stenosis: Stenosis, mesh: Mesh) -> float:
    """Return R/h at the throat: its radius over the mean width of the tetrahedra within half a radius along the vessel.

    The width is the edges' mean length across the vessel, divided by π/4, its value for edges of unit length in all
    directions; where elements are as long as wide it is the edge length.
    """
    place, radius = throat(tree, stenosis)
    vessel = tree[stenosis.vessel]
    centre, tangent = vessel.position_at(place), vessel.tangent_at(place)
    offset = mesh.points[mesh.tets].mean(axis=1) - centre
    axial = np.abs(offset @ tangent)
    near = (axial < 0.5 * radius) & (np.linalg.norm(offset, axis=1) < 1.5 * radius)
    across = mesh.points - ((mesh.points - centre) @ tangent)[:, None] * tangent
    width = quality.edge_lengths(across, mesh.tets[near]).mean() / (np.pi / 4.0) if near.any() else np.inf
    return float(radius / width)
