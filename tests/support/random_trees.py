"""Random coronary trees: tortuous, tapering, branching, with stenoses; vessels do not touch except where they meet."""

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, distance_to
from coronaryuq.case.network.build import Bed, network_from_tree
from coronaryuq.core.seeds import generator

SPACING = 0.03


def random_tree(seed: int, generations: int = 3) -> tuple[Tree, list[Stenosis]]:
    """A tree of 3 to 2**generations outlets and one or two stenoses of 30 to 70 % by diameter."""
    rng = generator(seed, "random tree")
    while True:
        vessels: list[Vessel] = []
        _grow(rng, vessels, np.zeros(3), _unit(rng.normal(size=3)), rng.uniform(0.16, 0.24), None, generations)
        tree = Tree(_narrowed(rng, vessels))
        if len(tree.leaves()) >= 3 and _apart(tree):
            return tree, _stenoses(tree)


def network_of(tree: Tree, stenoses: list[Stenosis]) -> dict:
    """The closed loop around a tree whose root leaves the heart itself."""
    return network_from_tree(tree, [Bed(f"BC_{v.name}", v.name, right=False) for v in tree.leaves()], {}, stenoses)


def tube(
    length: float = 3.0, radius: float = 0.15, severity: float = 0.0, width: float = 1.0
) -> tuple[Tree, list[Stenosis]]:
    """A straight tube along x, with a cosine narrowing in its middle that takes `severity` of the radius."""
    x = np.linspace(0.0, length, int(np.ceil(length / 0.02)) + 1)
    radii = radius * (1.0 - severity * _bump((x - 0.5 * length) / width))
    points = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    middle = 0.5 * length
    stenoses = [Stenosis("LAD", "LAD", middle - 0.5 * width, middle + 0.5 * width)] if severity else []
    return Tree([Vessel("LAD", points, radii, None, "LAD")]), stenoses


def _bump(x: np.ndarray) -> np.ndarray:
    return np.where(np.abs(x) < 0.5, 0.5 * (1.0 + np.cos(2.0 * np.pi * x)), 0.0)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _grow(rng, vessels: list, start, direction, radius: float, parent: str | None, generations: int) -> None:
    length = rng.uniform(8.0, 16.0) * radius + 0.4
    points, heading = [start], direction
    for _ in range(int(np.ceil(length / SPACING))):
        heading = _unit(heading + 0.12 * rng.normal(size=3) * np.sqrt(SPACING / 0.1))
        points.append(points[-1] + SPACING * heading)
    points = np.array(points)
    for _ in range(40):
        points[1:-1] = 0.25 * (points[:-2] + 2.0 * points[1:-1] + points[2:])
    end = radius * rng.uniform(0.8, 0.95)
    name = f"v{len(vessels)}"
    vessels.append(Vessel(name, points, np.linspace(radius, end, len(points)), parent, "LAD"))
    if generations == 0 or (parent is not None and generations == 1 and rng.random() < 0.4) or end < 0.06:
        return
    ahead = _unit(points[-1] - points[-8])
    side = _unit(np.cross(ahead, rng.normal(size=3)))
    small = rng.uniform(0.5, 0.95)
    first = end / (1.0 + small**2.6) ** (1.0 / 2.6)
    for share, angle in ((1.0, rng.uniform(0.1, 0.5)), (small, -rng.uniform(0.6, 1.2))):
        way = np.cos(angle) * ahead + np.sin(angle) * side
        _grow(rng, vessels, points[-1], way, max(first * share, 0.05), name, generations - 1)


def _narrowed(rng, vessels: list[Vessel]) -> list[Vessel]:
    chosen = rng.choice(len(vessels), size=min(len(vessels), int(rng.integers(1, 3))), replace=False)
    for index in chosen:
        v = vessels[index]
        middle, width = rng.uniform(0.4, 0.6) * v.length, rng.uniform(0.35, 0.6) * v.length
        radii = v.radii * (1.0 - rng.uniform(0.3, 0.7) * _bump((v.arc - middle) / width))
        vessels[index] = Vessel(v.name, v.points, radii, v.parent, v.branch)
    return vessels


def _stenoses(tree: Tree) -> list[Stenosis]:
    found = []
    for vessel in tree:
        healthy = np.interp(vessel.arc, vessel.arc[[0, -1]], vessel.radii[[0, -1]])
        narrow = np.flatnonzero(vessel.radii < 0.999 * healthy)
        if len(narrow):
            name = ("LAD", "LCx", "RCA")[len(found)]
            found.append(Stenosis(name, vessel.name, float(vessel.arc[narrow[0]]), float(vessel.arc[narrow[-1]])))
    return found


def _apart(tree: Tree) -> bool:
    """Whether vessels that do not meet keep a radius of distance, and those that meet part for good."""
    vessels = list(tree)
    for i, a in enumerate(vessels):
        for b in vessels[:i]:
            gap = distance_to(b, a.points) - a.radii
            if b.name == a.parent or b.parent == a.parent:
                near = a.arc < 5.0 * max(b.radii[-1] if b.name == a.parent else b.radii[0], a.radii[0])
                if np.any(gap[~near] < a.radii[0]):
                    return False
            elif np.any(gap < np.minimum(a.radii, b.radii.min())):
                return False
    return True
