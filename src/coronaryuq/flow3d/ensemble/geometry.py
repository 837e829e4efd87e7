"""What the solver reads of a mesh: `mesh-complete/` and `mesh.json` as nodes, caps, stenosis regions and planes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.flow3d.mesh.generation import folder


@dataclass(frozen=True)
class Geometry:
    """points (n, 3) cm, tets (m, 4); caps: name → triangles; inlets: names of the caps where blood enters.

    regions: stenosis → wall triangles (k, 3) in its region; planes: stenosis → (point, normal) distal to it.
    description: `mesh.json` itself.
    """

    points: np.ndarray
    tets: np.ndarray
    caps: dict[str, np.ndarray]
    inlets: list[str]
    regions: dict[str, np.ndarray]
    planes: dict[str, tuple[np.ndarray, np.ndarray]]
    description: dict


def read_geometry(mesh_dir: str | Path, mesh_json: str | Path) -> Geometry:
    """Read a mesh folder and its description; `InputError` when one does not fit the other."""
    mesh, description = folder.read(mesh_dir), read_json(mesh_json, ("faces", "regions", "planes"))
    caps, inlets = {}, []
    number = {name: k for k, name in mesh.caps.items()}
    for face in description["faces"]:
        if face["kind"] != "cap":
            continue
        name = face["name"]
        if name not in number:
            raise InputError(mesh_json, "faces", name, f"no such cap in {Path(mesh_dir).name}; mesh the case again")
        caps[name] = mesh.triangles[mesh.face == number[name]]
        if face["couples"]["flow"] == "in":
            inlets.append(name)
    regions = {name: mesh.triangles[mesh.region == region["id"]] for name, region in description["regions"].items()}
    for name, triangles in regions.items():
        if not len(triangles):
            raise InputError(mesh_json, f"regions.{name}", None, "no wall triangle belongs to it; mesh the case again")
    planes = {
        name: (np.array(plane["point"]), np.array(plane["normal"])) for name, plane in description["planes"].items()
    }
    return Geometry(mesh.points, mesh.tets, caps, inlets, regions, planes, description)
