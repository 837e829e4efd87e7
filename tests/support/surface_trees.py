"""Trees whose surfaces are made and traced back."""

import numpy as np

from coronaryuq.case.anatomy.centrelines import centreline_tree
from coronaryuq.case.anatomy.surface import Surface
from coronaryuq.case.anatomy.tree import Tree, Vessel
from coronaryuq.core.seeds import generator
from support.case_files import straight


def random_tree(seed: int, outlets: int) -> Tree:
    """A short aorta with two coronary trees of curved, tapering, dividing vessels: `outlets` coronary ends in all."""
    random = generator(seed, "surface tree")
    vessels = [
        straight("aorta", (0, 0, 0), (0, 0, 1), 1.2, (0.7, 0.7)),
        straight("aorta_outlet", (0, 0, 1.2), (0, 0, 1), 1.5, (0.7, 0.7), "aorta"),
    ]
    count = 0

    def grow(start, heading, normal, radius, parent, ends, first):
        nonlocal count
        length = (1.9 if first else 0.9) + 5 * radius
        bend = random.uniform(-0.35, 0.35)
        t = np.linspace(0, 1, 31)[:, None]
        points = start + length * (t * heading + 0.5 * bend * t**2 * normal)
        count += 1
        name = f"c{count}"
        vessels.append(
            type(vessels[0])(name, points, radius * np.linspace(1.0, 0.9, 31), parent, "LAD" if start[0] else "RCA")
        )
        if ends == 1:
            return
        out = points[-1] - points[-2]
        out /= np.linalg.norm(out)
        side = np.cross(out, normal)
        side /= np.linalg.norm(side)
        share = ends // 2
        # Planes of division alternate, so that branches keep apart.
        for sign, part in ((1, share), (-1, ends - share)):
            way = out * np.cos(0.7) + sign * np.sin(0.7) * normal
            grow(points[-1], way / np.linalg.norm(way), side, 0.85 * radius, name, part, False)

    left = outlets // 2
    grow(np.array([0, 0, 1.2]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 0.2, "aorta", left, True)
    grow(np.array([0, 0, 1.2]), np.array([-1.0, 0, 0]), np.array([0, 1.0, 0]), 0.2, "aorta", outlets - left, True)
    return Tree(vessels)


def recovered(tree: Tree, surface: Surface) -> Tree:
    def cap_at(place):
        return min(surface.caps, key=lambda cap: float(np.linalg.norm(cap.centre - place)))

    ends = {v.name: cap_at(v.points[-1]) for v in tree.leaves()}
    return centreline_tree("surface", surface, cap_at(tree.root.points[0]), ends)


def resistance(path: list[Vessel], begin: float) -> float:
    """Integral of radius^-4 along a path from `begin` (cm) on, to which Poiseuille's resistance is proportional."""
    total, before = 0.0, 0.0
    for vessel in path:
        arc, radius = (vessel.arc[1:] + vessel.arc[:-1]) / 2 + before, (vessel.radii[1:] + vessel.radii[:-1]) / 2
        total += float(np.sum((np.diff(vessel.arc) / radius**4)[arc > begin]))
        before += vessel.length
    return total


def topology(tree: Tree) -> set[frozenset[str]]:
    """Sets of ends that share a vessel: what a tree is, whatever its inner vessels are called."""
    ends = {v.name for v in tree.leaves()}
    return {frozenset(v.name for v in tree.subtree(w.name) if v.name in ends) for w in tree}
