"""A drawing of a 0D network that comes without anatomy: true lengths and radii, invented directions."""

import networkx as nx
import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel, branch_of
from coronaryuq.case.network.topology import CORONARY, Topology

FAN = np.radians(150.0)
"""Angle over which the ends of the network are spread, in the plane z = 0."""
SHORTEST = 0.05
"""cm drawn for a vessel without a length."""


def schematic_tree(topology: Topology, density: float, branches: dict[str, str]) -> Tree:
    """Draw a network as straight vessels in a plane; branches: coronary boundary condition → LAD, LCx or RCA."""
    (root,) = topology.roots
    ends = [v for v in nx.dfs_preorder_nodes(topology.graph, root) if not topology.children(v)]
    angle = {v: FAN * (k / max(len(ends) - 1, 1) - 0.5) for k, v in enumerate(ends)}
    vessels: dict[str, Vessel] = {}
    for name in topology.subtree(root):
        fed = [v for v in topology.subtree(name) if v in angle]
        direction = float(np.mean([angle[v] for v in fed]))
        parent = next(iter(topology.parents(name)), None)
        start = np.zeros(3) if parent is None else vessels[parent].points[-1]
        length = max(topology.length(name), SHORTEST)
        points = start + np.linspace(0, length, 11)[:, None] * [np.cos(direction), np.sin(direction), 0.0]
        radius = radius_from_inertance(topology, name, density)
        owners = {
            branches.get(bc, AORTA) if topology.kind(bc) in CORONARY else AORTA for bc in topology.outlets_below(name)
        }
        vessels[name] = Vessel(name, points, np.full(11, radius or 0.1), parent, branch_of(owners))
    return Tree(vessels.values())


def radius_from_inertance(topology: Topology, vessel: str, density: float) -> float | None:
    """Return the radius (cm) that the inertance L = ρ l / (π r²) implies; None if L or l is missing."""
    inertance = float(topology.network.vessel_values(vessel).get("L") or 0.0)
    length = topology.length(vessel)
    if inertance <= 0 or length <= 0:
        return None
    return float(np.sqrt(density * length / (np.pi * inertance)))
