"""`mesh.json`: everything a solver must know of a mesh beside its nodes."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, throat
from coronaryuq.flow3d.mesh.coupling.caps import couple, parts_of
from coronaryuq.flow3d.mesh.generation import quality
from coronaryuq.flow3d.mesh.generation.build import Built
from coronaryuq.flow3d.mesh.generation.folder import Mesh, face_geometry
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.zerod.network.read import Network

FORMAT = "coronaryuq-mesh-1"


def describe(
    tree: Tree,
    stenoses: Sequence[Stenosis],
    network: Network,
    built: Built,
    regions: dict,
    planes: dict,
    settings: Settings,
) -> dict:
    """The content of `mesh.json`, laid out in the docstring of `coronaryuq.flow3d.mesh`."""
    mesh = built.mesh
    coupled = couple(tree, built.kept, parts_of(tree, stenoses, network), network, built.caps)
    return {
        "format": FORMAT,
        "domain": settings.domain,
        "nodes": len(mesh.points),
        "tets": len(mesh.tets),
        "volume": float(quality.volumes(mesh.points, mesh.tets).sum()),
        "pieces": [{name: list(map(float, built.kept[name])) for name in group} for group in built.pieces],
        "faces": faces(mesh, coupled["caps"]),
        "replaces": coupled["replaces"],
        "cut": coupled["cut"],
        "regions": regions,
        "planes": planes,
        "quality": shape(mesh) | {"throat_resolution": {s.name: resolution(tree, s, mesh) for s in stenoses}},
        "failed_attempts": built.failures,
        "settings": settings.model_dump(mode="json"),
    }


def faces(mesh: Mesh, couples: dict) -> list[dict]:
    """One entry a face; caps carry what they couple."""
    entries = []
    for number, name in mesh.names.items():
        kind = "cap" if number in mesh.caps else "wall"
        geometry = face_geometry(mesh, number)
        entry = {"name": name, "kind": kind, "ModelFaceID": int(number), "area": geometry["area"]}
        if kind == "cap":
            entry |= geometry | {"couples": couples[name]}
        entries.append(entry)
    return entries


def shape(mesh: Mesh) -> dict:
    """Element quality: radius ratio (1 is regular), dihedral angles (degrees), smallest altitude (cm)."""
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
    """R/h at the throat: its radius over the mean width of the tetrahedra within half a radius of it along the vessel.

    The width is what their edges measure across the vessel over π/4, the share of edges in all directions, so that it
    is the edge's length where elements are as long as wide.
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
