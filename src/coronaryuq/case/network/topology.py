"""Who feeds whom in a 0D network, and what svZeroDSolver calls the places in it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coronaryuq.core.errors import InputError

CORONARY = {"ClosedLoopCoronaryLeft": False, "ClosedLoopCoronaryRight": True}
"""Closed-loop coronary beds → whether right."""
SYSTEMIC = "ClosedLoopRCR"
HEART = "ClosedLoopHeartAndPulmonary"
AFTER_HEART = "J_heart_outlet"
"""Junction that svZeroDSolver puts between the heart and the vessels that it feeds."""


@dataclass(frozen=True)
class Graph:
    """Vessels of a closed-loop network by name: values, parent, children, boundary condition, junctions at its ends."""

    values: dict[str, Mapping[str, Any]]
    lengths: dict[str, float]
    parent: dict[str, str | None]
    children: dict[str, list[str]]
    bc: dict[str, str]
    types: dict[str, str]
    before: dict[str, str]
    after: dict[str, str]
    root: str
    period: float

    def inlet(self, vessel: str) -> str:
        """Location of a vessel's inlet, such as `J3:branch4_seg0`."""
        return f"{self.before[vessel]}:{vessel}"

    def outlet(self, vessel: str) -> str:
        """Location of a vessel's outlet, such as `branch4_seg0:J4` or `lca1:BC_lca1`."""
        return f"{vessel}:{self.after[vessel]}"

    def path(self, vessel: str) -> list[str]:
        """Vessels from the heart to `vessel`, both included."""
        path = [vessel]
        while self.parent[path[0]] is not None:
            path.insert(0, self.parent[path[0]])
        return path

    def downstream(self, vessel: str) -> list[str]:
        """`vessel` and every vessel fed through it."""
        inside = [vessel]
        for name in inside:
            inside.extend(self.children[name])
        return inside

    def beds(self, vessel: str) -> list[str]:
        """Boundary conditions fed through `vessel`."""
        return [self.bc[name] for name in self.downstream(vessel) if name in self.bc]

    def at(self, bc: str) -> str:
        """The vessel that ends in boundary condition `bc`."""
        return next(name for name, at in self.bc.items() if at == bc)


def graph_of(network: Mapping[str, Any], path: str | Path) -> Graph:
    """Read who feeds whom from svZeroDSolver JSON; what is missing or dangling is an `InputError` that names the block.

    Only the structure is checked here: a tree of vessels from the heart to closed-loop beds. What an element may hold
    is the solver's to say.
    """
    vessels, bcs, junctions, loops = (
        _blocks(network, key, path) for key in ("vessels", "boundary_conditions", "junctions", "closed_loop_blocks")
    )
    if len(loops) != 1 or loops[0].get("closed_loop_type") != HEART:
        raise InputError(path, "closed_loop_blocks", None, f"wanted one block of type {HEART}")
    names = {_get(v, "vessel_id", "vessels", path): str(_get(v, "vessel_name", "vessels", path)) for v in vessels}
    if len(set(names.values())) != len(vessels):
        raise InputError(path, "vessels", None, "two vessels share a name or an id")
    types = {
        _get(b, "bc_name", "boundary_conditions", path): _get(b, "bc_type", "boundary_conditions", path) for b in bcs
    }
    bc = {}
    for vessel in vessels:
        ends = vessel.get("boundary_conditions") or {}
        if "inlet" in ends:
            raise InputError(
                path, vessel["vessel_name"], ends["inlet"], "an inlet condition in a closed loop; remove it"
            )
        if "outlet" in ends:
            if ends["outlet"] not in types:
                raise InputError(path, vessel["vessel_name"], ends["outlet"], "no such boundary condition")
            bc[str(vessel["vessel_name"])] = ends["outlet"]
    parent: dict[str, str | None] = dict.fromkeys(names.values())
    before: dict[str, str] = {}
    after: dict[str, str] = dict(bc)
    children: dict[str, list[str]] = {name: [] for name in names.values()}
    for junction in junctions:
        label = _get(junction, "junction_name", "junctions", path)
        ends = [_get(junction, key, f"junction {label}", path) for key in ("inlet_vessels", "outlet_vessels")]
        for number in (*ends[0], *ends[1]):
            if number not in names:
                raise InputError(path, f"junction {label}", number, "no vessel has this id")
        if len(ends[0]) != 1:
            raise InputError(path, f"junction {label}", len(ends[0]), "inlet vessels; wanted one, vessels form a tree")
        feeder = names[ends[0][0]]
        if feeder in after:
            raise InputError(path, f"junction {label}", feeder, f"already ends at {after[feeder]}")
        after[feeder] = label
        for number in ends[1]:
            if parent[names[number]] is not None:
                raise InputError(path, f"junction {label}", names[number], "is fed twice; vessels form a tree")
            parent[names[number]], before[names[number]] = feeder, label
            children[feeder].append(names[number])
    roots = [str(name) for name in _get(loops[0], "outlet_blocks", "closed_loop_blocks", path)]
    if len(roots) != 1 or roots[0] not in children:
        raise InputError(path, "outlet_blocks", roots, "wanted the one vessel that leaves the heart")
    before[roots[0]] = AFTER_HEART
    for name in names.values():
        if name not in before:
            raise InputError(path, f"vessel {name}", None, "nothing feeds it")
        if name not in after:
            raise InputError(path, f"vessel {name}", None, "ends nowhere; give it a boundary condition or a junction")
    graph = Graph(
        values={str(v["vessel_name"]): v.get("zero_d_element_values") or {} for v in vessels},
        lengths={str(v["vessel_name"]): float(v.get("vessel_length") or 0.0) for v in vessels},
        parent=parent,
        children=children,
        bc=bc,
        types=types,
        before=before,
        after=after,
        root=roots[0],
        period=float(loops[0].get("cardiac_cycle_period") or 1.0),
    )
    if set(graph.downstream(graph.root)) != set(names.values()):
        raise InputError(path, "vessels", None, f"some are not fed by {graph.root}; vessels form one tree")
    return graph


def _blocks(network: Mapping[str, Any], key: str, path) -> list[dict]:
    blocks = network.get(key) if isinstance(network, Mapping) else None
    if not isinstance(blocks, list) or not all(isinstance(block, dict) for block in blocks):
        raise InputError(path, key, None, "missing; wanted a closed-loop network as svZeroDSolver writes it")
    return blocks


def _get(block: Mapping[str, Any], key: str, where: str, path) -> Any:
    if key not in block:
        raise InputError(path, f"{where}.{key}", None, "missing")
    return block[key]
