"""How the nodes on a mesh's surface follow the radii of the vessels: radially from each axis, forks as a whole.

All moves are linear in the ratios of radii, so that a draw costs one product per vessel.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.flow3d.mesh.geometry.extent import Kept, clearance, daughters
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit, Path
from coronaryuq.flow3d.mesh.geometry.paths import smooth

WIDTH = 0.5
"""Difference of distances from two vessels' walls, in radii, up to which both move a node: the blend at a fork."""
FADE = 5.0
"""Distance from a fork at which it moves no node along a vessel, over that at which the vessel's wall stands alone."""


@dataclass(frozen=True)
class Moves:
    """What one vessel does to some nodes: `nodes` (k,), `arc` (k,) cm along it, and how far they move.

    A node moves across the vessel by (ratio of radii there − 1) times `across` (k, 3) cm, and along it by (ratio of
    fork − 1) times `along[fork]` (k, 3) cm.
    """

    nodes: np.ndarray
    arc: np.ndarray
    across: np.ndarray
    along: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Fork:
    """Vessels that meet at the end of one: name → arc length (cm) and weight, its share of their summed areas."""

    ends: Mapping[str, tuple[float, float]]


def forks(tree: Tree, kept: Kept) -> dict[str, Fork]:
    """Return the forks inside the mesh, by the name of the vessel that divides there."""
    found = {}
    for name in kept:
        below = daughters(tree, kept, name)
        if below:
            arcs = {name: tree[name].length} | dict.fromkeys(below, 0.0)
            area = {vessel: float(tree[vessel].radius_at(arc)) ** 2 for vessel, arc in arcs.items()}
            total = sum(area.values())
            found[name] = Fork({vessel: (arc, area[vessel] / total) for vessel, arc in arcs.items()})
    return found


def surface_moves(tree: Tree, kept: Kept, points: np.ndarray, nodes: np.ndarray) -> dict[str, Moves]:
    """Return vessel → how it moves the surface's nodes.

    Away from forks a cross-section keeps its shape, and its area changes by the squared ratio of radii. Where vessels
    meet, each counts with a weight that falls from one, for the wall nearest to the node, to zero at `WIDTH` radii. A
    fork whose vessels all change by one ratio grows or shrinks as a whole, since its ridges move along the vessels;
    that part fades out along each vessel.

    Parameters
    ----------
    tree
        The segmented lumen that the mesh was made from.
    kept
        Stretch of every vessel that is meshed.
    points, nodes
        (n, 3) nodes of the mesh, cm, and the numbers (k,) of those on its surface.
    """
    feet = {name: _Feet(tree, name, interval, points[nodes]) for name, interval in kept.items()}
    nearest = np.min([foot.depth for foot in feet.values()], axis=0)
    weight = {
        name: np.maximum(0.0, 1.0 - (foot.depth - nearest) / (WIDTH * foot.radius)) ** 2 for name, foot in feet.items()
    }
    total = np.sum(list(weight.values()), axis=0)
    meeting = forks(tree, kept)
    moves = {}
    for name, foot in feet.items():
        own = np.flatnonzero(weight[name] > 0.0)
        if not len(own):
            continue
        share = (weight[name][own] / total[own])[:, None]
        along = {
            fork: share * _reach(tree, kept, fork, name, foot.place[own])[:, None] * foot.tangent[own]
            for fork in meeting
            if name in meeting[fork].ends
        }
        moves[name] = Moves(nodes[own], foot.arc[own], share * foot.across[own], along)
    return moves


class _Feet:
    """Nearest places on one vessel's axis to points (k, 3).

    arc (k,), radius (k,) and depth (k,), the signed distance from the vessel's wall, cm; across (k, 3): offset from the
    axis, across it; tangent (k, 3); place (k,): arc length of the point along the axis, beyond its ends too.
    """

    def __init__(self, tree: Tree, name: str, interval: tuple[float, float], points: np.ndarray):
        arc, line, radii = smooth(tree[name], *interval)
        implicit = Implicit([Path(line, radii, np.full(len(arc), name), arc, 0.0)])
        _, segment, t = implicit.nearest(points)

        def at(values: np.ndarray) -> np.ndarray:
            share = t if values.ndim == 1 else t[:, None]
            return (1.0 - share) * values[segment] + share * values[segment + 1]

        offset = points - at(line)
        tangent = line[segment + 1] - line[segment]
        self.tangent = tangent / np.linalg.norm(tangent, axis=1)[:, None]
        beyond = np.einsum("ij,ij->i", offset, self.tangent)
        self.arc, self.radius = at(arc), at(radii)
        self.depth = np.linalg.norm(offset, axis=1) - self.radius
        self.across = offset - beyond[:, None] * self.tangent
        self.place = self.arc + beyond


def _reach(tree: Tree, kept: Kept, fork: str, name: str, place: np.ndarray) -> np.ndarray:
    """Return the signed distance (k,) cm from a fork along a vessel, fading to zero away from it."""
    below = [tree[vessel] for vessel in daughters(tree, kept, fork)]
    if name == fork:
        away, sign = tree[name].length - place, -1.0
        alone = 2.0 * float(tree[name].radii[-1])
    else:
        away, sign = place, 1.0
        alone = max(clearance(tree[fork], tree[name], below), 2.0 * float(tree[name].radii[0]))
    start, end = kept[name]
    # A vessel between two forks gives each of them its half; one that ends in a cap is at rest there.
    last = (end - start) * (0.5 if _forked_at_both_ends(tree, kept, name) else 0.9)
    first = min(alone, last / FADE)
    last = min(FADE * alone, last)
    fade = np.clip((last - away) / (last - first), 0.0, 1.0)
    return sign * away * fade**2 * (3.0 - 2.0 * fade)


def _forked_at_both_ends(tree: Tree, kept: Kept, name: str) -> bool:
    parent = tree[name].parent
    return bool(daughters(tree, kept, name)) and parent is not None and name in daughters(tree, kept, parent)


def displacement(
    moves: Mapping[str, Moves], ratio: Mapping[str, np.ndarray], fork_ratio: Mapping[str, float], nodes: int
) -> np.ndarray:
    """Return the displacement (nodes, 3) cm of all nodes.

    ratio: vessel → ratio of radii (k,) at its `arc`; fork_ratio: fork → its mean ratio.
    """
    moved = np.zeros((nodes, 3))
    for name, own in moves.items():
        moved[own.nodes] += (ratio[name] - 1.0)[:, None] * own.across
        for fork, along in own.along.items():
            moved[own.nodes] += (fork_ratio[fork] - 1.0) * along
    return moved
