"""The ways through a coronary tree to its ends, as evenly spaced points."""

from collections.abc import Collection, Sequence

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, Vessel

SPACING = 0.1
"""cm between the points."""
FIRST = 0.5
"""Share of the right coronary artery's and the circumflex's length that lies in the groove between atria and
ventricles in any heart."""


class Paths:
    """Ways through a tree; the points of every vessel and the ends behind it are found once.

    Parameters
    ----------
    tree
        Vessels, cm.
    """

    def __init__(self, tree: Tree):
        self.tree = tree
        self._points: dict[str, np.ndarray] = {}
        self._ends: dict[str, list[str]] = {vessel.name: [] for vessel in tree}
        for leaf in tree.leaves():
            for vessel in tree.path(leaf.name):
                self._ends[vessel.name].append(leaf.name)

    def ends(self, vessel: str) -> list[str]:
        """Return the names of the ends that a vessel feeds."""
        return self._ends[vessel]

    def points(self, vessels: Sequence[Vessel]) -> np.ndarray:
        """Return points (n, 3) along some vessels, one after the other."""
        for vessel in vessels:
            if vessel.name not in self._points:
                self._points[vessel.name] = vessel.resampled(SPACING).points
        return np.concatenate([self._points[vessel.name] for vessel in vessels])

    def to(self, end: str) -> np.ndarray:
        """Return the whole way (n, 3) to an end."""
        return self.points(self.tree.path(end))

    def own_vessels(self, end: str, own: Collection[str]) -> list[Vessel]:
        """Return the vessels on the way to an end that feed none but the ends `own`."""
        known = frozenset(own)
        return [v for v in self.tree.path(end) if known.issuperset(self.ends(v.name))]

    def course(self, end: str, own: Collection[str]) -> np.ndarray:
        """Return the way (n, 3) to an end along the vessels that feed none but the ends `own`."""
        return self.points(self.own_vessels(end, own))

    def longest(self, ends: Sequence[str]) -> str:
        """Return the one of the ends of an artery with the longest course."""
        return max(ends, key=lambda end: len(self.course(end, ends)))

    def behind(self, place: str, end: str) -> np.ndarray:
        """Return the way (n, 3) to an end from the end of the vessel `place`."""
        path = self.tree.path(end)
        return self.points(path[[v.name for v in path].index(place) + 1 :])

    def ways(self, place: str, own: Collection[str]) -> dict[str, list[np.ndarray]]:
        """Return for each child of a vessel the ways (n, 3) from there to those of the ends `own` that it feeds."""
        wanted = frozenset(own)
        found = {}
        for child in self.tree.children(place):
            ways = [self.behind(place, end) for end in self.ends(child.name) if end in wanted]
            if ways:
                found[child.name] = ways
        return found


def first_part(points: np.ndarray) -> np.ndarray:
    """Return the first part of a course (n, 3), in which an artery of the groove still lies there."""
    return points[: max(3, int(FIRST * len(points)))]


def in_groove_with(paths: Paths, ends: Sequence[str], right: np.ndarray) -> np.ndarray:
    """Return the first part of the course to one of the ends that lies best in a plane with the right artery's.

    All courses are cut to one length, that of the longest; shorter ones do not count.
    """
    courses = [paths.course(end, ends) for end in ends]
    length = len(first_part(max(courses, key=len)))
    long_enough = [points[:length] for points in courses if len(points) >= length]
    return min(long_enough, key=lambda points: off_plane(np.vstack([right, points])))


def off_plane(points: np.ndarray) -> float:
    """Return the root mean square distance of points (n, 3) from their plane."""
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points)))
