"""Which stretch of every vessel is meshed: whole tree, trees from their ostia, or stenosed segments."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel, distance_to

Kept = dict[str, tuple[float, float]]
"""Vessel name → arc interval (cm) in 3D."""


def whole(tree: Tree) -> Kept:
    """Keep every vessel from end to end."""
    return {vessel.name: (0.0, vessel.length) for vessel in tree}


def trees(tree: Tree) -> Kept:
    """Keep every coronary tree from its ostium; the aorta stays 0D. A tree without an aorta is kept whole."""
    kept = {v.name: (ostium(tree, v.name), v.length) for v in tree if v.branch != AORTA}
    return kept or whole(tree)


def segments(
    tree: Tree, stenoses: Sequence[Stenosis], upstream: float = 3.0, downstream: float = 5.0, stub: float = 2.0
) -> Kept:
    """Keep each stenosis with `upstream` and `downstream` diameters of its artery, joining neighbours that overlap.

    Downstream it is kept to one diameter beyond the place at which its FFR is read, if that is farther.

    A bifurcation inside the neighbourhood is kept whole, each of its vessels for at least `stub` of its own diameters
    beyond the others' walls. A cut that would fall within a bifurcation is moved before it if half of the requested
    length remains and the place of FFR stays a radius before the cut, and beyond it otherwise. A remainder shorter than
    one diameter at the end of a vessel goes into 3D as well.
    """
    kept: Kept = {}
    for stenosis in stenoses:
        _keep(kept, stenosis.vessel, stenosis.start, stenosis.end)
        vessel = tree[stenosis.vessel]
        _upstream(tree, kept, vessel, stenosis.start, 2.0 * upstream * float(vessel.radius_at(stenosis.start)))
        behind = 2.0 * downstream * float(vessel.radius_at(stenosis.end))
        read = None if stenosis.read is None else stenosis.read.arc
        if read is not None:
            behind = max(behind, read - stenosis.end + 2.0 * float(vessel.radius_at(read)))
        _downstream(tree, kept, vessel, stenosis.end, behind, read)
    _complete_bifurcations(tree, kept, stub)
    return kept


def ostium(tree: Tree, name: str) -> float:
    """Return the arc length (cm) at which a vessel begins outside the aorta; 0 for one that does not arise from it.

    Half a radius beyond the place where its axis leaves the lumen, so that a flat cap fits.
    """
    vessel = tree[name]
    if not tree.ostial(vessel):
        return 0.0
    out = tree.emergence(name)
    return min(out + 0.5 * float(vessel.radius_at(out)), 0.5 * vessel.length)


def starts_at_bifurcation(tree: Tree, kept: Kept, name: str) -> bool:
    """Return whether a vessel's 3D part begins at the end of its parent's."""
    parent = tree[name].parent
    return parent is not None and kept[name][0] <= 0.0 and reaches_end(tree, kept, parent)


def daughters(tree: Tree, kept: Kept, name: str) -> list[str]:
    """Return the vessels that continue from the end of this one in 3D."""
    return [v.name for v in tree.children(name) if v.name in kept and starts_at_bifurcation(tree, kept, v.name)]


def reaches_end(tree: Tree, kept: Kept, name: str) -> bool:
    return name in kept and kept[name][1] >= tree[name].length


def pieces(tree: Tree, kept: Kept) -> list[list[str]]:
    """Return the connected components of the kept intervals, each a list of vessels, parents first."""
    label: dict[str, str] = {}
    for vessel in tree:
        if vessel.name in kept:
            joined = starts_at_bifurcation(tree, kept, vessel.name)
            label[vessel.name] = label[vessel.parent] if joined and vessel.parent else vessel.name
    return [[name for name in label if label[name] == first] for first in dict.fromkeys(label.values())]


def continuation(tree: Tree, parent: str, names: Sequence[str]) -> str:
    """Return the daughter that continues the parent: same artery first, then wide and straight."""
    trunk = tree[parent]
    ahead = trunk.tangent_at(trunk.length)

    def rank(name: str) -> tuple[bool, float]:
        daughter = tree[name]
        radius = float(daughter.radius_at(0.0))
        straight = 1.0 + float(ahead @ daughter.tangent_at(min(daughter.length, 2.0 * radius)))
        return daughter.branch == trunk.branch, straight * radius

    return max(names, key=rank)


def _keep(kept: Kept, name: str, start: float, end: float) -> None:
    old = kept.get(name, (start, end))
    kept[name] = (min(old[0], start), max(old[1], end))


def _upstream(tree: Tree, kept: Kept, vessel: Vessel, end: float, length: float) -> None:
    """Keep `length` (cm) upstream of `end`, through bifurcations where needed."""
    first = ostium(tree, vessel.name)
    room, margin = end - first, 2.0 * float(vessel.radius_at(first))
    if length <= room - margin:
        _keep(kept, vessel.name, end - length, end)
    elif vessel.parent is None or tree.ostial(vessel):
        _keep(kept, vessel.name, min(first, end), end)
    elif room - margin >= 0.5 * length:
        _keep(kept, vessel.name, margin, end)
    else:
        _keep(kept, vessel.name, 0.0, end)
        parent = tree[vessel.parent]
        _upstream(tree, kept, parent, parent.length, max(length - room, 2.0 * float(parent.radii[-1])))


def _downstream(tree: Tree, kept: Kept, vessel: Vessel, start: float, length: float, read: float | None = None) -> None:
    """Keep `length` (cm) downstream of `start`, through bifurcations where needed.

    read: arc length (cm) of a cross-section that must lie a radius before the cut.
    """
    room, margin = vessel.length - start, 2.0 * float(vessel.radii[-1])
    before = vessel.length - margin
    holds_read = read is None or read <= before - float(vessel.radius_at(before))
    if length <= room - margin:
        _keep(kept, vessel.name, start, start + length)
    elif not tree.children(vessel.name):
        _keep(kept, vessel.name, start, vessel.length)
    elif room - margin >= 0.5 * length and holds_read:
        _keep(kept, vessel.name, start, before)
    else:
        _keep(kept, vessel.name, start, vessel.length)
        onward = tree[continuation(tree, vessel.name, [v.name for v in tree.children(vessel.name)])]
        _downstream(tree, kept, onward, 0.0, max(length - room, 4.0 * float(onward.radii[0])))


def _complete_bifurcations(tree: Tree, kept: Kept, stub: float) -> None:
    """Grow every vessel at a junction that lies inside until its cap is clear of its neighbours."""
    before: Kept = {}
    while kept != before:
        before = dict(kept)
        for parent in tree:
            below = tree.children(parent.name)
            touched = reaches_end(tree, kept, parent.name) or any(
                v.name in kept and kept[v.name][0] <= 0.0 for v in below
            )
            if not below or not touched:
                continue
            length = 2.0 * max(stub * float(parent.radii[-1]), *(float(v.radii[0]) for v in below))
            first = ostium(tree, parent.name)
            start = parent.length - length
            near = start < first + 2.0 * float(parent.radius_at(first))
            _keep(kept, parent.name, min(first, parent.length) if near else start, parent.length)
            for daughter in below:
                end = clearance(parent, daughter, below) + 2.0 * stub * float(daughter.radii[0])
                near = end > daughter.length - 2.0 * float(daughter.radii[-1])
                _keep(kept, daughter.name, 0.0, daughter.length if near else end)


def clearance(parent: Vessel, daughter: Vessel, siblings: Sequence[Vessel]) -> float:
    """Return the arc length at which a daughter's lumen has left those of its parent and siblings."""
    reach = 8.0 * float(max(parent.radii[-1], *(v.radii[0] for v in siblings)))
    arc = np.linspace(0.0, min(reach, daughter.length), 60)
    points, radii = daughter.position_at(arc), daughter.radius_at(arc)
    near = [parent.between(max(0.0, parent.length - reach), parent.length)]
    near += [v.between(0.0, min(reach, v.length)) for v in siblings if v.name != daughter.name]
    gap = np.min([distance_to(other, points) for other in near], axis=0) - radii
    touching = np.flatnonzero(gap < 0.0)
    return float(arc[touching[-1]]) if len(touching) else 0.0
