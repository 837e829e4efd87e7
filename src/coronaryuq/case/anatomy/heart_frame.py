"""The heart's own directions, as its coronary arteries tell them.

The right coronary artery and the circumflex run in the groove between atria and ventricles, whose plane the apex faces.
The LAD and the posterior descending artery (PDA) run towards the apex in the grooves between the ventricles, on
opposite sides of the heart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.anatomy.paths import SPACING, Paths, first_part, in_groove_with
from coronaryuq.case.anatomy.tree import Vessel
from coronaryuq.case.case_json import Branch

AHEAD = 3.0
"""cm of a course behind a bifurcation that tell which way it goes."""
DEPARTURE = 1.5
"""cm of a branch that tell whether it runs over the heart or dives into it."""
DIVES = 1 / 3
"""Share of that by which a septal branch leaves the heading of the LAD into the heart, at least: 20 degrees."""
OSTIAL = 2.0
"""cm of the right coronary artery from its ostium, which lies above the groove, in the sinus of the aorta."""
SMALLEST, LARGEST = 2.0, 8.0
"""cm: radius of the groove between atria and ventricles in adult hearts, small and dilated ones included."""
REACH = 0.25
"""Share of the way from the groove to the apex, as far as the LAD reaches, that a PDA has at least."""
ASIDE = 30.0
"""Degrees round the heart within which a PDA lies opposite the LAD: half a segment of the left ventricle."""
INFERIOR = 0.75
"""Share of the way round the left ventricle's free wall, from LAD to PDA, where its inferior segment begins: the free
wall has four segments of 60 degrees (Cerqueira et al. 2002)."""


@dataclass(frozen=True)
class HeartFrame:
    """Centre of the groove between atria and ventricles, and unit vectors at right angles, cm.

    apex: from the base to the apex. anterior: from the centre to the LAD. left: to the left ventricle's free wall.
    wall: centre of the left ventricle's base.
    """

    centre: np.ndarray
    apex: np.ndarray
    anterior: np.ndarray
    left: np.ndarray
    wall: np.ndarray

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return how far (cm) points (..., 3) lie from the groove towards the apex."""
        return (points - self.centre) @ self.apex

    def aside(self, points: np.ndarray) -> np.ndarray:
        """Return how far (cm) points (..., 3) lie left of the plane between the ventricles."""
        return (points - self.centre) @ self.left

    def opposite(self, points: np.ndarray) -> np.ndarray:
        """Return the degrees round the heart from opposite the LAD to points (..., 3)."""
        return np.degrees(np.arctan2(self.aside(points), -(points - self.centre) @ self.anterior))

    def round_wall(self, points: np.ndarray) -> np.ndarray:
        """Return the angle (0 to 2π) round the left ventricle of points (..., 3), rising from anterior over left."""
        from_middle = points - self.wall
        return np.arctan2(from_middle @ self.left, from_middle @ self.anterior) % (2 * np.pi)


@dataclass(frozen=True)
class Courses:
    """The heart's frame, and the ends of the courses that are known by it.

    lad: the end towards the apex. circumflex, right: the ends of the courses that stay in the groove between atria and
    ventricles. pda: the end in the posterior groove between the ventricles, None where none is to be seen.
    mirrored: whether the circumflex lies where the mirror image of a heart has it.
    """

    frame: HeartFrame
    lad: str
    circumflex: str
    right: str
    pda: str | None
    mirrored: bool


def find_courses(paths: Paths, branches: Mapping[str, Branch]) -> Courses | None:
    """Return the heart's frame and the courses in its grooves.

    None unless LAD, LCx and RCA are all there, and RCA and LCx lie on a circle that can be a heart's groove.

    Parameters
    ----------
    paths
        Ways through the tree.
    branches
        Coronary end → its artery.
    """
    own = {branch: [end for end in branches if branches[end] == branch] for branch in ("LAD", "LCx", "RCA")}
    if not all(own.values()):
        return None
    right = first_part(paths.course(paths.longest(own["RCA"]), own["RCA"]))
    circumflex = in_groove_with(paths, own["LCx"], right)
    groove = np.vstack([right[min(round(OSTIAL / SPACING), len(right) // 2) :], circumflex])
    everywhere = np.array([paths.tree[end].points[-1] for end in branches])
    apex = _normal(groove)
    apex = apex if ((everywhere - groove.mean(axis=0)) @ apex).mean() > 0 else -apex
    centre, radius = _circle(groove, apex)
    if not SMALLEST <= radius <= LARGEST:
        return None
    deepest = max((paths.course(end, own["LAD"]) for end in own["LAD"]), key=lambda points: (points @ apex).max())
    anterior = first_part(deepest).mean(axis=0) - centre
    anterior = _unit(anterior - (anterior @ apex) * apex)
    left = np.cross(apex, anterior)
    mirrored = bool(((circumflex - centre) @ left).mean() > 0)
    left = left if mirrored else -left
    frame = HeartFrame(centre, apex, anterior, left, centre)
    lad = _towards_apex(paths, own["LAD"], frame)
    ends = {branch: _groove_end(paths, own[branch], frame) for branch in ("LCx", "RCA")}
    pda = _posterior_descending(paths, own, frame, lad)
    along = [first_part(paths.course(ends["LCx"], own["LCx"])), paths.course(lad, own["LAD"])[:10]]
    wall, _ = _circle(np.vstack(along), apex)
    return Courses(HeartFrame(centre, apex, anterior, left, wall), lad, ends["LCx"], ends["RCA"], pda, mirrored)


def is_inferior(paths: Paths, end: str, courses: Courses) -> bool:
    """Return whether an end other than the PDA lies on the inferior segment of the left ventricle's free wall."""
    if courses.pda is None or end == courses.pda:
        return False
    frame = courses.frame
    lad = float(frame.round_wall(first_part(paths.course(courses.lad, [courses.lad])).mean(axis=0)))
    pda = float(frame.round_wall(apical_middle(paths, courses.pda, frame)))
    angle = float(frame.round_wall(paths.tree[end].points[-1]))
    whole = (pda - lad) % (2 * np.pi)
    return INFERIOR * whole < (angle - lad) % (2 * np.pi) < whole


def _normal(points: np.ndarray) -> np.ndarray:
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][-1]


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _circle(points: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre and radius of the circle through points (n, 3), seen along an axis, at their mean height."""
    middle = points.mean(axis=0)
    across = np.linalg.svd(np.eye(3) - np.outer(axis, axis))[0][:, :2]
    flat = (points - middle) @ across
    solution = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None)[0]
    return middle + across @ solution[:2], float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))


def apical_middle(paths: Paths, end: str, frame: HeartFrame) -> np.ndarray:
    """Return the middle (3,) of the part of an end's course that lies in the farther half of its way to the apex.

    An end on the atria's side of the groove is its own middle.
    """
    points = paths.to(end)
    heights = frame.height(points)
    return points[heights >= heights[-1] / 2].mean(axis=0) if heights[-1] > 0 else points[-1]


def reach(paths: Paths, end: str, frame: HeartFrame) -> float:
    """Return how far (cm) the course to an end gets towards the apex, which it may pass."""
    return float(frame.height(paths.to(end)).max())


def _along_posterior_groove(frame: HeartFrame, point: np.ndarray) -> float:
    """Return how far (cm) an end (3,) lies towards the apex and the surface behind, less how far aside."""
    outwards = -float((point - frame.centre) @ frame.anterior)
    return float(frame.height(point)) + outwards - abs(float(frame.aside(point)))


def _towards_apex(paths: Paths, ends: Sequence[str], frame: HeartFrame) -> str:
    """Return the end of the LAD's own course: at every bifurcation, the way that gets farthest to the apex.

    Distance aside of the plane between the ventricles counts against a way. One that dives into the heart is a
    septal branch and does not count, unless all do.
    """
    own = {*ends}
    at = _start(paths, ends)
    while at.name not in own:
        ways = paths.ways(at.name, own)
        length = min(DEPARTURE, SPACING * min(max(map(len, courses)) for courses in ways.values()))
        inwards = {
            name: min(departure(paths, at.name, points, frame, length)[1] for points in courses)
            for name, courses in ways.items()
        }
        on_surface = [name for name in ways if inwards[name] <= max(DIVES * length, min(inwards.values()))]

        def gets(name: str, ways=ways) -> float:
            deepest = [points[int(np.argmax(frame.height(points)))] for points in ways[name]]
            return max(float(frame.height(point) - abs(frame.aside(point))) for point in deepest)

        at = paths.tree[max(on_surface or ways, key=gets)]
    return at.name


def departure(
    paths: Paths, place: str, points: np.ndarray, frame: HeartFrame, length: float = DEPARTURE
) -> tuple[float, float]:
    """Return how far (cm) a branch leads to the left and into the heart where it leaves the LAD.

    Parameters
    ----------
    paths
        Ways through the tree.
    place
        The vessel of the LAD at whose end it leaves, whose heading tells the surface there.
    points
        The branch's course (n, 3) from there.
    frame
        The heart's frame.
    length
        cm of the course that count.
    """
    before = paths.to(place)
    heading = _unit(before[-1] - before[max(-len(before), -round(DEPARTURE / SPACING))])
    outwards = np.cross(frame.left, heading)
    outwards = _unit(outwards if outwards @ frame.anterior > 0 else -outwards)
    along = points[min(len(points) - 1, max(1, round(length / SPACING)))] - points[0]
    return float(along @ frame.left), -float(along @ outwards)


def _start(paths: Paths, ends: Sequence[str]) -> Vessel:
    """Return the first vessel of the longest course to some of the ends."""
    return paths.own_vessels(paths.longest(ends), ends)[0]


def _groove_end(paths: Paths, ends: Sequence[str], frame: HeartFrame) -> str:
    """Return the end of the course that, at every bifurcation, leads least towards the apex."""
    own = {*ends}
    at = _start(paths, ends)
    while at.name not in own:
        ways = paths.ways(at.name, own)
        count = int(min(AHEAD / SPACING, *(max(map(len, courses)) for courses in ways.values())))
        start = float(frame.height(at.points[-1]))

        def descent(name: str, courses, count=count, start=start) -> float:
            long_enough = [points[:count] for points in courses[name] if len(points) >= count]
            return min(float(frame.height(points).mean()) - start for points in long_enough)

        at = paths.tree[min(ways, key=lambda name: descent(name, ways))]
    return at.name


def _posterior_descending(paths: Paths, own: Mapping[str, Sequence[str]], frame: HeartFrame, lad: str) -> str | None:
    """Return the end of RCA or LCx that leads to the apex opposite the LAD."""
    enough = REACH * reach(paths, lad, frame)
    candidates = {}
    for branch in ("RCA", "LCx"):
        for end in own[branch]:
            behind = abs(float(frame.opposite(apical_middle(paths, end, frame)))) <= ASIDE
            if behind and float(frame.height(paths.tree[end].points[-1])) >= enough:
                candidates[end] = _along_posterior_groove(frame, paths.tree[end].points[-1])
    return max(candidates, key=candidates.__getitem__, default=None)
