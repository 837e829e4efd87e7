"""A drawing of a 0D network that comes without anatomy: true lengths and radii, invented directions."""

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel, branch_of
from coronaryuq.case.network.topology import CORONARY, Graph

FAN = np.radians(150.0)
"""Angle over which the ends of the network are spread, in the plane z = 0."""
SHORTEST = 0.05
"""cm drawn for a vessel without a length."""


def schematic_tree(graph: Graph, density: float, branches: dict[str, str]) -> Tree:
    """Straight vessels in a plane. branches: coronary boundary condition → LAD, LCx or RCA."""
    ends = [v for v in graph.downstream(graph.root) if not graph.children[v]]
    in_order = [v for v in _depth_first(graph, graph.root) if v in ends]
    angle = {v: FAN * (k / max(len(in_order) - 1, 1) - 0.5) for k, v in enumerate(in_order)}
    vessels: dict[str, Vessel] = {}
    for name in graph.downstream(graph.root):
        fed = [v for v in graph.downstream(name) if v in angle]
        towards = float(np.mean([angle[v] for v in fed]))
        parent = graph.parent[name]
        start = np.zeros(3) if parent is None else vessels[parent].points[-1]
        length = max(graph.lengths[name], SHORTEST)
        points = start + np.linspace(0, length, 11)[:, None] * [np.cos(towards), np.sin(towards), 0.0]
        radius = radius_from_inertance(graph, name, density)
        owners = {branches.get(bc, AORTA) for bc in graph.beds(name) if graph.types[bc] in CORONARY}
        owners |= {AORTA for bc in graph.beds(name) if graph.types[bc] not in CORONARY}
        vessels[name] = Vessel(name, points, np.full(11, radius or 0.1), parent, branch_of(owners))
    return Tree(vessels.values())


def radius_from_inertance(graph: Graph, vessel: str, density: float) -> float | None:
    """Radius (cm) that the vessel's inertance implies, L = ρ l / (π r²); None where L or l is missing."""
    inertance, length = float(graph.values[vessel].get("L") or 0.0), graph.lengths[vessel]
    if inertance <= 0 or length <= 0:
        return None
    return float(np.sqrt(density * length / (np.pi * inertance)))


def _depth_first(graph: Graph, name: str) -> list[str]:
    return [name, *(v for child in graph.children[name] for v in _depth_first(graph, child))]
