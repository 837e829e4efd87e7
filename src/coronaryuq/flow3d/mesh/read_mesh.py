"""A mesh as a flow solver uses it: nodes, tetrahedra, caps, stenosis regions and planes."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.description import MeshDescription, read_description
from coronaryuq.flow3d.mesh.generation import folder


@dataclass(frozen=True)
class Domain:
    """The 3D domain.

    Parameters
    ----------
    points
        (n, 3) nodes, cm.
    tets
        (m, 4) tetrahedra.
    caps
        Cap name → (k, 3) triangles, in the order of the description's faces.
    inlets
        Names of the caps where blood enters.
    regions
        Stenosis → (k, 3) wall triangles of its region.
    planes
        Stenosis → point (3,) in cm and unit normal (3,) of the plane distal to it.
    description
        Content of `mesh.json`.
    proximal_planes
        Stenosis → point and normal of the plane before it.
    """

    points: np.ndarray
    tets: np.ndarray
    caps: dict[str, np.ndarray]
    inlets: list[str]
    regions: dict[str, np.ndarray]
    planes: dict[str, tuple[np.ndarray, np.ndarray]]
    description: MeshDescription
    proximal_planes: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def read_domain(mesh_folder: str | Path, mesh_json: str | Path) -> Domain:
    """Read a `mesh-complete` folder and its description; raise `InputError` if one does not fit the other."""
    return domain_of(folder.read(mesh_folder), read_description(mesh_json), mesh_json)


def domain_of(mesh: folder.Mesh, description: MeshDescription, mesh_json: str | Path = "mesh.json") -> Domain:
    """Return the domain of a mesh and its description; raise `InputError` if one does not fit the other."""
    number = {name: k for k, name in mesh.caps.items()}
    caps = {}
    for name in description.caps:
        if name not in number:
            raise InputError(mesh_json, "faces", name, "the mesh has no such cap; regenerate it")
        caps[name] = mesh.triangles[mesh.face == number[name]]
    inlets = [name for name, couples in description.caps.items() if couples.enters]
    regions = {name: mesh.triangles[mesh.region == region.id] for name, region in description.regions.items()}
    for name, triangles in regions.items():
        if not len(triangles):
            raise InputError(mesh_json, f"regions.{name}", None, "no wall triangle belongs to it; regenerate the mesh")
    planes, proximal = (
        {name: (np.array(plane.point), np.array(plane.normal)) for name, plane in of.items()}
        for of in (description.planes, description.proximal_planes)
    )
    return Domain(mesh.points, mesh.tets, caps, inlets, regions, planes, description, proximal)
