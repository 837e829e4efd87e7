"""How the nodes on a mesh's surface follow the radii of the vessels: radially from each axis, forks as a whole."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

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
class Axis:
    """The axis of a vessel: arc lengths (m,), points (m, 3) and segmented radii (m,), cm."""

    arc: np.ndarray
    points: np.ndarray
    radii: np.ndarray

    def point(self, arc: np.ndarray) -> np.ndarray:
        """Return points (k, 3) at arc lengths (k,), straight on beyond the ends."""
        beyond = arc - np.clip(arc, self.arc[0], self.arc[-1])
        ends = np.diff(self.points[[0, 1]], axis=0)[0], np.diff(self.points[[-2, -1]], axis=0)[0]
        first, last = (end / np.linalg.norm(end) for end in ends)
        inside = np.stack([np.interp(arc, self.arc, self.points[:, k]) for k in range(3)], axis=-1)
        return inside + np.where(beyond > 0.0, beyond, 0.0)[:, None] * last + np.minimum(beyond, 0.0)[:, None] * first


@dataclass(frozen=True)
class Moves:
    """How some nodes follow one vessel: `nodes` (k,), their weight (k,), place `arc` (k,) cm along `axis`.

    A node keeps its direction `across` (k, 3) cm from the axis, and moves along it by (ratio of fork - 1) times
    `along[fork]` (k,) cm; its distance from the axis changes as the radius from the old place to the new one.
    """

    nodes: np.ndarray
    weight: np.ndarray
    axis: Axis
    arc: np.ndarray
    across: np.ndarray
    along: Mapping[str, np.ndarray]

    def shift(self, radius_ratio: Callable[[np.ndarray], np.ndarray], fork_ratio: Mapping[str, float]) -> np.ndarray:
        """Return the weighted displacement (k, 3) cm; radius_ratio: arc lengths → ratios of radii."""
        place = self.arc + sum(((fork_ratio[fork] - 1.0) * own for fork, own in self.along.items()), 0.0)
        before = np.interp(self.arc, self.axis.arc, self.axis.radii)
        ratio = radius_ratio(place) * np.interp(place, self.axis.arc, self.axis.radii) / before
        moved = self.axis.point(place) - self.axis.point(self.arc) + (ratio - 1.0)[:, None] * self.across
        return self.weight[:, None] * moved


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
        along = {
            fork: _reach(tree, kept, fork, name, foot.place[own]) for fork in meeting if name in meeting[fork].ends
        }
        moves[name] = Moves(
            nodes[own], weight[name][own] / total[own], foot.axis, foot.arc[own], foot.across[own], along
        )
    return moves


class _Feet:
    """Nearest places on one vessel's axis to points (k, 3).

    arc (k,), radius (k,) and depth (k,), the signed distance from the vessel's wall, cm; across (k, 3): offset from the
    axis, across it; place (k,): arc length of the point along the axis, beyond its ends too.
    """

    def __init__(self, tree: Tree, name: str, interval: tuple[float, float], points: np.ndarray):
        arc, line, radii = smooth(tree[name], *interval)
        self.axis = Axis(arc, line, radii)
        implicit = Implicit([Path(line, radii, np.full(len(arc), name), arc, 0.0)])
        _, segment, t = implicit.nearest(points)

        def at(values: np.ndarray) -> np.ndarray:
            share = t if values.ndim == 1 else t[:, None]
            return (1.0 - share) * values[segment] + share * values[segment + 1]

        offset = points - at(line)
        tangent = line[segment + 1] - line[segment]
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        beyond = np.einsum("ij,ij->i", offset, tangent)
        self.arc, self.radius = at(arc), at(radii)
        self.depth = np.linalg.norm(offset, axis=1) - self.radius
        self.across = offset - beyond[:, None] * tangent
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
    moves: Mapping[str, Moves],
    radius_ratio: Callable[[str, np.ndarray], np.ndarray],
    fork_ratio: Mapping[str, float],
    nodes: int,
) -> np.ndarray:
    """Return the displacement (nodes, 3) cm of all nodes.

    radius_ratio: vessel and arc lengths (k,) → ratios of radii (k,); fork_ratio: fork → its mean ratio.
    """
    moved = np.zeros((nodes, 3))
    for name, own in moves.items():
        moved[own.nodes] += own.shift(partial(radius_ratio, name), fork_ratio)
    return moved
