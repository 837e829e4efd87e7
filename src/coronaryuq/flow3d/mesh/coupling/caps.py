"""What each cap cuts in the 0D network, what the mesh replaces there, and what is left of vessels cut in the middle."""

from collections.abc import Sequence

from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.network.build import Physics, Segment, elements
from coronaryuq.case.network.build import segments as network_segments
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.geometry.extent import Kept
from coronaryuq.flow3d.mesh.geometry.paths import Cap
from coronaryuq.zerod.network.read import Network, junction_sides, vessel_names

TOLERANCE = 1e-6
"""cm; a cap nearer than this to the end of a 0D vessel cuts its connection rather than the vessel."""


def parts_of(tree: Tree, stenoses: Sequence[Stenosis], network: Network, file: str = "network") -> list[Segment]:
    """The 0D vessels along the tree: as the case made them, or one to each vessel of the same name.

    Raises InputError when the network has neither.
    """
    known = {vessel["vessel_name"] for vessel in network["vessels"]}
    made = network_segments(tree, stenoses)
    if {part.name for part in made} <= known:
        return made
    if {vessel.name for vessel in tree} <= known:
        return [Segment(v.name, v.name, tree.emergence(v.name), v.length) for v in tree]
    missing = sorted({part.name for part in made} - known)
    raise InputError(file, "vessels", missing[0], "the tree has it and the network has not; give both the same names")


def upstream_block(network: Network, vessel: str) -> str:
    """Name of the block before a vessel, as svZeroDSolver writes it: junction, boundary condition, or the heart's
    outlet.
    """
    ids = vessel_names(network)
    for junction in network.get("junctions", []):
        if vessel in junction_sides(junction, ids)[1]:
            return junction["junction_name"]
    for loop in network.get("closed_loop_blocks", []):
        if vessel in loop["outlet_blocks"]:
            return "J_heart_outlet"
    return _boundary(network, vessel, "inlet")


def downstream_block(network: Network, vessel: str) -> str:
    """Name of the block behind a vessel: junction or boundary condition."""
    ids = vessel_names(network)
    for junction in network.get("junctions", []):
        if vessel in junction_sides(junction, ids)[0]:
            return junction["junction_name"]
    return _boundary(network, vessel, "outlet")


def _boundary(network: Network, vessel: str, side: str) -> str:
    block = next(v for v in network["vessels"] if v["vessel_name"] == vessel)
    try:
        return block["boundary_conditions"][side]
    except KeyError:
        raise InputError("network", f"vessels.{vessel}", None, f"nothing is connected to its {side}") from None


def couple(tree: Tree, kept: Kept, parts: Sequence[Segment], network: Network, caps: Sequence[Cap]) -> dict:
    """`{"caps": {cap: couples}, "replaces": [...], "cut": {...}}` as described in `coronaryuq.flow3d.mesh`."""
    couples, cut = {}, {}
    for cap in caps:
        part, share = _owner(tree, parts, cap)
        if share is None:
            if cap.inlet:
                ends = {"upstream": upstream_block(network, part.name), "downstream": part.name}
            else:
                ends = {"upstream": part.name, "downstream": downstream_block(network, part.name)}
        else:
            ends = {"upstream": part.name, "downstream": part.name}
            cut.setdefault(part.name, {})["upstream" if cap.inlet else "downstream"] = share
        couples[cap.name] = ends | {"flow": "in" if cap.inlet else "out"}
    replaces = [part.name for part in parts if part.name not in cut and _inside(kept, part)]
    return {"caps": couples, "replaces": replaces, "cut": cut}


def _inside(kept: Kept, part: Segment) -> bool:
    if part.vessel not in kept:
        return False
    start, end = kept[part.vessel]
    return 0.5 * (part.start + part.end) > start and 0.5 * (part.start + part.end) < end


def _owner(tree: Tree, parts: Sequence[Segment], cap: Cap) -> tuple[Segment, dict[str, float] | None]:
    """The 0D vessel that a cap touches, and the share of its elements that stays outside (None: the cap is at its
    end).
    """
    here = [part for part in parts if part.vessel == cap.vessel]
    vessel = tree[cap.vessel]
    if cap.inlet:
        part = next((p for p in here if cap.arc < p.end - TOLERANCE), here[-1])
        ostial = part is here[0] and tree.ostial(vessel) and cap.arc - part.start < 1.5 * cap.radius
        if ostial or cap.arc <= part.start + TOLERANCE:
            return part, None
        return part, _share(tree, part, part.start, cap.arc)
    part = next((p for p in reversed(here) if cap.arc > p.start + TOLERANCE), here[0])
    if cap.arc >= part.end - TOLERANCE:
        return part, None
    return part, _share(tree, part, cap.arc, part.end)


def _share(tree: Tree, part: Segment, start: float, end: float) -> dict[str, float]:
    physics = Physics(elastic=True)
    full = elements(tree[part.vessel].between(part.start, part.end), physics)
    left = elements(tree[part.vessel].between(start, end), physics)
    return {name: left[name] / full[name] for name in ("R_poiseuille", "L", "C")} | {"stenosis_coefficient": 0.0}
