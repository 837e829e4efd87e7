"""The 0D vessels along a centreline tree."""

from collections.abc import Sequence

from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.network.build import Segment, segments
from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError


def vessels_along(tree: Tree, stenoses: Sequence[Stenosis], network: Network, file: str = "network") -> list[Segment]:
    """Return the 0D vessels along the tree: those that the case stage makes, or one per tree vessel of the same name.

    Raises `InputError` if the network has neither.
    """
    known = set(network.vessel_names.values())
    made = segments(tree, stenoses, [bed["bc_name"] for bed in network.boundary_conditions])
    if {segment.name for segment in made} <= known:
        return made
    if {vessel.name for vessel in tree} <= known:
        return [Segment(v.name, v.name, tree.emergence(v.name), v.length) for v in tree]
    missing = sorted({segment.name for segment in made} - known)
    raise InputError(file, "vessels", missing[0], "in the tree but not in the network; give both the same names")
