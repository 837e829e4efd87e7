"""Topology of a 0D network, and svZeroDSolver's names of the locations in it."""

from collections.abc import Mapping
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import networkx as nx

from coronaryuq.case.network.network import AFTER_HEART, HEART_TYPE, Entry, Network
from coronaryuq.core.errors import InputError

CORONARY = {"ClosedLoopCoronaryLeft": False, "ClosedLoopCoronaryRight": True}
"""Closed-loop coronary beds → whether right."""
SYSTEMIC = "ClosedLoopRCR"


class Topology:
    """The vessels of a network as a directed graph, and the blocks at their ends.

    Attributes
    ----------
    vessels, blocks : dict of str to dict
        Vessels and boundary conditions by name, in the network's order.
    graph : networkx.DiGraph
        One node per vessel, an edge to each vessel that it feeds through a junction.
    upstream, downstream : dict of str to str
        Vessel → block before and behind it: a junction, a boundary condition, or the heart's outlet.
    inlet_bc, outlet_bc : dict of str to str
        Vessel → boundary condition at its start or end, where there is one.
    """

    def __init__(self, content: Mapping[str, Any]):
        self.network = network = content if isinstance(content, Network) else Network(content)
        self.vessels = {vessel["vessel_name"]: vessel for vessel in network.vessels}
        self.blocks = {block["bc_name"]: block for block in network.boundary_conditions}
        self.graph = nx.DiGraph()
        self.graph.add_nodes_from(self.vessels)
        self.upstream: dict[str, str] = {}
        self.downstream: dict[str, str] = {}
        for junction in network.junctions:
            feeding, fed = (
                [name for name in side if name in self.vessels] for side in network.junction_sides(junction)
            )
            name: str = junction["junction_name"]
            self.downstream |= dict.fromkeys(feeding, name)
            self.upstream |= dict.fromkeys(fed, name)
            self.graph.add_edges_from(product(feeding, fed))
        self.inlet_bc, self.outlet_bc = (
            {name: ends[side] for name, vessel in self.vessels.items() if side in (ends := _ends(vessel))}
            for side in ("inlet", "outlet")
        )
        self.upstream |= self.inlet_bc
        self.downstream |= self.outlet_bc
        for name in network.heart.get("outlet_blocks", []) if network.closed_loop else []:
            self.upstream.setdefault(name, AFTER_HEART)

    @property
    def closed_loop(self) -> bool:
        return self.network.closed_loop

    @cached_property
    def roots(self) -> list[str]:
        """Vessels that no other vessel feeds."""
        return [name for name in self.vessels if not self.graph.pred[name]]

    @cached_property
    def vessel_of(self) -> dict[str, str]:
        """Boundary condition → vessel that ends in it."""
        return {bed: vessel for vessel, bed in self.outlet_bc.items()}

    def parents(self, vessel: str) -> list[str]:
        """Return the vessels that feed `vessel`."""
        return list(self.graph.pred[vessel])

    def children(self, vessel: str) -> list[str]:
        """Return the vessels that `vessel` feeds directly."""
        return list(self.graph.succ[vessel])

    def path(self, vessel: str) -> list[str]:
        """Return the vessels from the root to `vessel`, both included."""
        return nx.shortest_path(self.graph, self.root_of(vessel), vessel)

    def root_of(self, vessel: str | None) -> str:
        """Return the first of the roots that feed a vessel; the first of all if none does."""
        above = nx.ancestors(self.graph, vessel) | {vessel} if vessel in self.graph else set()
        return next((root for root in self.roots if root in above), self.roots[0])

    def subtree(self, vessel: str) -> list[str]:
        """Return `vessel` and every vessel that it feeds, the nearest first."""
        return [vessel, *(fed for _, fed in nx.bfs_edges(self.graph, vessel))]

    def outlets_below(self, vessel: str) -> list[str]:
        """Return the boundary conditions that `vessel` feeds."""
        return [self.outlet_bc[name] for name in self.subtree(vessel) if name in self.outlet_bc]

    def kind(self, bed: str) -> str:
        """Return the type of a boundary condition."""
        return self.blocks[bed]["bc_type"]

    def length(self, vessel: str) -> float:
        """Return a vessel's length (cm), 0 if it is not in the network."""
        return float(self.vessels[vessel].get("vessel_length") or 0.0)

    def inlet(self, vessel: str) -> str:
        """Return the location of a vessel's start, such as `J3:branch4_seg0`."""
        return f"{self.upstream[vessel]}:{vessel}"

    def outlet(self, vessel: str) -> str:
        """Return the location of a vessel's end, such as `branch4_seg0:J4` or `lca1:BC_lca1`."""
        return f"{vessel}:{self.downstream[vessel]}"


def closed_loop_tree(network: Mapping[str, Any], path: str | Path) -> Topology:
    """Read a network whose vessels form one tree from the heart to closed-loop beds.

    Only the structure is checked; `zerod.network.read` checks the values of elements.

    Parameters
    ----------
    network : mapping
        svZeroDSolver JSON, unchecked.
    path : str or Path
        File for error messages.

    Returns
    -------
    Topology
        With one root, the vessel that leaves the heart.

    Raises
    ------
    InputError
        If something is missing, dangling or connected twice; names the block.
    """
    vessels, beds, loops = (
        _blocks(network, key, path) for key in ("vessels", "boundary_conditions", "closed_loop_blocks")
    )
    junctions = _blocks(network, "junctions", path) if "junctions" in network else []
    if len(loops) != 1 or loops[0].get("closed_loop_type") != HEART_TYPE:
        raise InputError(path, "closed_loop_blocks", None, f"expected one block of type {HEART_TYPE}")
    roots = _get(loops[0], "outlet_blocks", "closed_loop_blocks", path)
    names = {_get(v, "vessel_id", "vessels", path): str(_get(v, "vessel_name", "vessels", path)) for v in vessels}
    if len(set(names.values())) != len(vessels):
        raise InputError(path, "vessels", None, "two vessels share a name or an id")
    known = {_get(bed, key, "boundary_conditions", path) for key in ("bc_type", "bc_name") for bed in beds}
    ends_at: dict[str, str] = {}
    for vessel in vessels:
        name, ends = names[vessel["vessel_id"]], _ends(vessel)
        if "inlet" in ends:
            raise InputError(path, name, ends["inlet"], "an inlet condition in a closed loop; remove it")
        if "outlet" in ends:
            if ends["outlet"] not in known:
                raise InputError(path, name, ends["outlet"], "no such boundary condition")
            ends_at[name] = ends["outlet"]
    fed = set()
    for junction in junctions:
        label = _get(junction, "junction_name", "junctions", path)
        inlets, outlets = (_get(junction, f"{side}_vessels", f"junction {label}", path) for side in ("inlet", "outlet"))
        for number in (*inlets, *outlets):
            if number not in names:
                raise InputError(path, f"junction {label}", number, "no vessel has this id")
        if len(inlets) != 1:
            raise InputError(path, f"junction {label}", len(inlets), "a junction must have exactly one inlet vessel")
        feeder = names[inlets[0]]
        if feeder in ends_at:
            raise InputError(path, f"junction {label}", feeder, f"already ends at {ends_at[feeder]}")
        ends_at[feeder] = label
        for name in (names[number] for number in outlets):
            if name in fed:
                raise InputError(path, f"junction {label}", name, "has two upstream junctions")
            fed.add(name)
    if len(roots) != 1 or roots[0] not in names.values():
        remedy = "expected the one vessel that leaves the heart; several arise from one aorta, joined by a junction"
        raise InputError(path, "outlet_blocks", roots, remedy)
    for name in names.values():
        if name not in fed and name != roots[0]:
            raise InputError(path, f"vessel {name}", None, "nothing feeds it")
        if name not in ends_at:
            raise InputError(path, f"vessel {name}", None, "has no downstream boundary condition or junction")
    topology = Topology(network)
    if topology.roots != roots or len(topology.subtree(roots[0])) < len(vessels):
        raise InputError(path, "vessels", None, f"some are not fed by {roots[0]}; vessels form one tree")
    return topology


def _ends(vessel: Entry) -> dict[str, str]:
    return vessel.get("boundary_conditions") or {}


def _blocks(network: Mapping[str, Any], key: str, path: str | Path) -> list[Entry]:
    blocks = network.get(key) if isinstance(network, Mapping) else None
    if not isinstance(blocks, list) or not all(isinstance(block, dict) for block in blocks):
        raise InputError(path, key, None, "missing; expected a closed-loop network as svZeroDSolver writes it")
    return blocks


def _get(block: Entry, key: str, where: str, path: str | Path) -> Any:
    if key not in block:
        raise InputError(path, f"{where}.{key}", None, "missing")
    return block[key]
