"""An artery that arises from an aorta, and what meshes of it replace."""

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import Bed, Physics, network_from_tree
from coronaryuq.case.network.network import Network
from coronaryuq.flow3d.mesh.coupling.cap_connections import connect_caps
from coronaryuq.flow3d.mesh.description import Face, MeshDescription
from coronaryuq.flow3d.mesh.generation.build import kept_vessels
from coronaryuq.flow3d.mesh.geometry import extent, paths
from coronaryuq.flow3d.mesh.settings import Settings

MIDDLE = Stenosis("LAD", "lca1", 2.5, 3.5)
OSTIAL = Stenosis("LAD", "lca1", 1.25, 2.0)
"""The aorta has a radius of 1.2 cm, so that the artery begins at 1.2 cm along its centreline."""


def artery(stenosis: Stenosis) -> Tree:
    """An aorta and one artery, wide at its ostium and narrow at the stenosis."""
    arc = np.linspace(0.0, 5.0, 201)
    radii = 0.16 + 0.06 * np.exp(-(((arc - 1.2) / 0.15) ** 2))
    radii = np.where((arc > stenosis.start) & (arc < stenosis.end), 0.09, radii)
    line = np.linspace(0.0, 2.0, 41)[:, None]
    return Tree(
        [
            Vessel("aorta", line * [0, 0, 1.0], np.full(41, 1.2), None, "aorta"),
            Vessel("lca1", [0, 0, 2.0] + arc[:, None] * [1.0, 0, 0], radii, "aorta", "LAD"),
            Vessel("aorta_outlet", [0, 0, 2.0] + line * [0, 0, 1.0], np.full(41, 1.2), "aorta", "aorta"),
        ]
    )


def entered(tree: Tree, stenosis: Stenosis, factor: float = 2.0) -> Network:
    beds, physics = [Bed("BC_lca1", "lca1", False)], Physics(kinetic_factor=factor)
    return network_from_tree(tree, beds, {"BC_RCR1": "aorta_outlet"}, [stenosis], physics)


def entrances(network: Network) -> list[str]:
    return [vessel["vessel_name"] for vessel in network.vessels if "entrance" in vessel]


def quadratic(network: Network, vessel: str) -> float:
    return network.vessel_values(vessel)["stenosis_coefficient"]


def mesh_of(tree: Tree, network: Network, domain: str) -> tuple[MeshDescription, dict[str, float]]:
    """Return what a mesh of a domain replaces, without the mesh, and the radius of each cap."""
    kept = kept_vessels(tree, [MIDDLE], Settings(domain=domain))
    caps = [cap for piece in extent.pieces(tree, kept) for cap in paths.caps(tree, kept, piece)]
    connections = connect_caps(tree, kept, vessels_along(tree, [MIDDLE], network), network, caps)
    faces = [Face(name=cap.name, kind="cap", couples=connections.caps[cap.name]) for cap in caps]
    replaced = {"replaces": connections.replaces, "cut": connections.cut}
    pieces = [{name: kept[name] for name in piece} for piece in extent.pieces(tree, kept)]
    described = MeshDescription(faces=faces, pieces=pieces, regions={}, planes={}, **replaced)
    return described, {cap.name: cap.radius for cap in caps}
