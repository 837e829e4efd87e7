"""The lumen that a 0D network without an anatomy implies: radii and throats from its resistances and inertances."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel
from coronaryuq.case.network.build import Segment
from coronaryuq.case.network.throats import implied_bore
from coronaryuq.case.network.topology import Topology

RAMP = 0.1
"""Length of each end of a throat over that of the throat."""


@dataclass(frozen=True)
class ImpliedLumen:
    """Radii along the vessels of a network.

    Parameters
    ----------
    tree
        The vessels with their throats. Those whose radius the network does not imply are part of the aorta, whose
        lumen is taken as known.
    stenoses
        Throats, by the vessels' names.
    segments
        The 0D vessels along the tree, one each.
    """

    tree: Tree
    stenoses: list[Stenosis]
    segments: list[Segment]


def implied_lumen(schematic: Tree, topology: Topology, density: float, viscosity: float) -> ImpliedLumen:
    """Return the lumen that the network's elements imply.

    Every vessel is a straight tube with the bore that `implied_bore` finds, its throat in the middle.

    Parameters
    ----------
    schematic
        The network's vessels as `schematic_tree` draws them.
    topology
        The network.
    density
        Of blood, g/cm3.
    viscosity
        Of blood, poise.
    """
    vessels, stenoses = [], []
    for vessel in schematic:
        bore = implied_bore(topology, vessel.name, density, viscosity)
        if bore is None or vessel.branch == AORTA:
            vessels.append(replace(vessel, branch=AORTA))
            continue
        vessel = replace(vessel, radii=np.full(len(vessel.arc), bore.radius))
        if bore.share:
            vessel, stenosis = _with_throat(vessel, np.sqrt(bore.ratio) * bore.radius, bore.share * vessel.length)
            stenoses.append(stenosis)
        vessels.append(vessel)
    tree = Tree(vessels)
    return ImpliedLumen(tree, stenoses, _segments(tree, stenoses))


def _with_throat(vessel: Vessel, radius: float, length: float) -> tuple[Vessel, Stenosis]:
    """Return the vessel with a throat in its middle."""
    middle, half = 0.5 * vessel.length, 0.5 * length
    start, end, ramp = middle - half, middle + half, RAMP * length
    healthy = float(vessel.radii[0])
    arc = np.array([0.0, start, start + ramp, end - ramp, end, vessel.length])
    radii = np.array([healthy, healthy, radius, radius, healthy, healthy])
    return replace(vessel, points=vessel.position_at(arc), radii=radii), Stenosis(vessel.name, vessel.name, start, end)


def _segments(tree: Tree, stenoses: Sequence[Stenosis]) -> list[Segment]:
    narrowed = {stenosis.vessel for stenosis in stenoses}
    return [Segment(v.name, v.name, 0.0, v.length, v.name if v.name in narrowed else None) for v in tree]
