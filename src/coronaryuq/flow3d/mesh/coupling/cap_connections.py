"""Which 0D connection each cap cuts, which 0D vessels the mesh replaces, and what is left of vessels cut in the middle.

Needs the centreline tree; runs when the mesh is made. `cut_network` applies the result to a network.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.network.build import Physics, Segment, elements
from coronaryuq.case.network.entrances import entrance_radius, entrance_share
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.description import Couples, Remainder
from coronaryuq.flow3d.mesh.geometry.extent import Kept
from coronaryuq.flow3d.mesh.geometry.paths import Cap

TOLERANCE = 1e-6
"""cm; a cap nearer than this to the end of a 0D vessel cuts its connection rather than the vessel."""


class Connections(NamedTuple):
    """Cap → what it couples; 0D vessels wholly inside 3D; vessel cut in the middle → what stays outside."""

    caps: dict[str, Couples]
    replaces: list[str]
    cut: dict[str, Remainder]


def upstream_block(network: Network, vessel: str) -> str:
    """Return the block before a vessel: a junction, a boundary condition or the heart's outlet."""
    return _beside(Topology(network).upstream, vessel, "inlet")


def downstream_block(network: Network, vessel: str) -> str:
    """Return the block behind a vessel: a junction or a boundary condition."""
    return _beside(Topology(network).downstream, vessel, "outlet")


def _beside(blocks: Mapping[str, str], vessel: str, side: str) -> str:
    if vessel not in blocks:
        raise InputError("network", f"vessels.{vessel}", None, f"nothing is connected to its {side}")
    return blocks[vessel]


def connect_caps(
    tree: Tree, kept: Kept, segments: Sequence[Segment], network: Network, caps: Sequence[Cap]
) -> Connections:
    """Return what each cap couples, and which 0D vessels the mesh replaces wholly or in part."""
    couples: dict[str, Couples] = {}
    cut: dict[str, dict[str, dict[str, float]]] = {}
    for cap in caps:
        segment, outside = _cut_segment(tree, segments, network, cap)
        name = segment.name
        if outside is not None:
            upstream = downstream = name
            cut.setdefault(name, {})["upstream" if cap.inlet else "downstream"] = outside
        elif cap.inlet:
            upstream, downstream = upstream_block(network, name), name
        else:
            upstream, downstream = name, downstream_block(network, name)
        couples[cap.name] = Couples(upstream=upstream, downstream=downstream, flow="in" if cap.inlet else "out")
    replaces = [segment.name for segment in segments if segment.name not in cut and _inside(kept, segment)]
    return Connections(couples, replaces, {name: Remainder(**sides) for name, sides in cut.items()})


def _inside(kept: Kept, segment: Segment) -> bool:
    if segment.vessel not in kept:
        return False
    start, end = kept[segment.vessel]
    return start < 0.5 * (segment.start + segment.end) < end


def _cut_segment(
    tree: Tree, segments: Sequence[Segment], network: Network, cap: Cap
) -> tuple[Segment, dict[str, float] | None]:
    """Return the 0D vessel that a cap touches and the share of its elements outside 3D; None for a cap at its end.

    Blood that enters 3D in an artery's first vessel has been sped up in 0D, to the mean speed at the cap, so that the
    vessel's entrance stays outside even where all its length lies inside.
    """
    along = [segment for segment in segments if segment.vessel == cap.vessel]
    if cap.inlet:
        segment = next((s for s in along if cap.arc < s.end - TOLERANCE), along[-1])
        at_ostium = segment is along[0] and tree.ostial(tree[cap.vessel]) and cap.arc - segment.start < 1.5 * cap.radius
        begin = segment.start if at_ostium or cap.arc <= segment.start + TOLERANCE else cap.arc
        entrance = entrance_share(network, segment.name)
        if begin == segment.start and not entrance:
            return segment, None
        outside = _share(tree, segment, segment.start, begin)
        if entrance:
            outside["stenosis_coefficient"] = entrance * (entrance_radius(tree, cap.vessel) / cap.radius) ** 4
        return segment, outside
    segment = next((s for s in reversed(along) if cap.arc > s.start + TOLERANCE), along[0])
    if cap.arc >= segment.end - TOLERANCE:
        return segment, None
    return segment, _share(tree, segment, cap.arc, segment.end)


def _share(tree: Tree, segment: Segment, start: float, end: float) -> dict[str, float]:
    if start == end:
        return dict.fromkeys(("R_poiseuille", "L", "C", "stenosis_coefficient"), 0.0)
    physics = Physics(elastic=True)
    whole = elements(tree[segment.vessel].between(segment.start, segment.end), physics)
    outside = elements(tree[segment.vessel].between(start, end), physics)
    return {name: outside[name] / whole[name] for name in ("R_poiseuille", "L", "C")} | {"stenosis_coefficient": 0.0}
