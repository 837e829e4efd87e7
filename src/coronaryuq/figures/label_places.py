"""Where the labels of a drawing go: beside their points, clear of one another, of markers and of lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

NEAR, STEP, RINGS = 0.035, 0.03, 12
"""Distances of a label from its point over the extent of the drawing: the smallest, between two, and how many."""
DIRECTIONS = 16
ROUNDS = 4
"""How often every label is placed, at most: from the second time on, all others are known."""
COVERED, PASSED, FAR, INWARDS = 20.0, 4.0, 0.35, 0.25
"""Costs of a label: for each label or marker that it covers; for each label or marker that its line passes, and each
line of another label that it covers; for each step from its point; for a full turn inwards. A point of a line of
the drawing that it covers, and one of its own line that lies on one, cost 1."""
LEADER = 24
"""Points along the line from a label to its point."""


@dataclass(frozen=True)
class Box:
    """A label's box: left, middle of the height, width and height; and whether it lies right of its point."""

    left: float
    middle: float
    width: float
    height: float
    right: bool

    @property
    def anchor(self) -> np.ndarray:
        """Middle of the side that faces the point."""
        return np.array([self.left if self.right else self.left + self.width, self.middle])

    @property
    def centre(self) -> np.ndarray:
        """Middle (2,) of the box."""
        return np.array([self.left + self.width / 2, self.middle])

    @property
    def half(self) -> np.ndarray:
        """Half of width and height (2,)."""
        return np.array([self.width, self.height]) / 2

    @property
    def corners(self) -> np.ndarray:
        """Lower left and upper right corner (2, 2)."""
        return np.array([self.centre - self.half, self.centre + self.half])


@dataclass(frozen=True)
class Discs:
    """Round things that labels shall not cover: centres (n, 2) and radii (n,)."""

    centres: np.ndarray
    radii: np.ndarray


def place_labels(
    points: np.ndarray, sizes: Sequence[tuple[float, float]], lines: Discs, markers: Discs, extent: float
) -> list[Box]:
    """Return a box for each label, where it costs least: first one after another, then each with all others known.

    Parameters
    ----------
    points
        (n, 2) points that are labelled.
    sizes
        Width and height of each label.
    lines
        Points along the lines of the drawing, evenly spaced, and half the width of the lines.
    markers
        Markers of the drawing.
    extent
        Extent of the drawing.
    """
    middle = points.mean(axis=0)
    around = [_around(point, size, middle, extent) for point, size in zip(points, sizes, strict=True)]
    fixed = [
        own
        + COVERED * _covered(boxes, markers)
        + _covered(boxes, lines)
        + PASSED * _passed(boxes, point, markers)
        + _crossed(boxes, point, lines, NEAR * extent)
        for (boxes, own), point in zip(around, points, strict=True)
    ]
    chosen: dict[int, Box] = {}
    for _ in range(ROUNDS):
        before = dict(chosen)
        for k, (boxes, _) in enumerate(around):
            others = [(box, points[j]) for j, box in chosen.items() if j != k]
            cost = fixed[k] + _of_others(boxes, points[k], others)
            chosen[k] = boxes[int(np.argmin(np.round(cost, 9)))]
        if chosen == before:
            break
    return [chosen[k] for k in range(len(points))]


def _around(
    point: np.ndarray, size: tuple[float, float], middle: np.ndarray, extent: float
) -> tuple[list[Box], np.ndarray]:
    """Return the boxes in which a label may lie, nearest first, and what each costs by its place alone."""
    away = (point - middle) / max(float(np.linalg.norm(point - middle)), 1e-9)
    boxes, costs = [], []
    for ring in range(RINGS):
        for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            towards = np.array([np.cos(angle), np.sin(angle)])
            x, y = point + (NEAR + ring * STEP) * extent * towards
            # Right above and below its point, a label may lie to either side.
            for right in (True, False) if abs(towards[0]) < 0.1 else (bool(towards[0] > 0),):
                boxes.append(Box(float(x if right else x - size[0]), float(y), *size, right))
                costs.append(FAR * ring + INWARDS * (1 - float(towards @ away)) / 2)
    return boxes, np.array(costs)


def _shape(boxes: Sequence[Box]) -> tuple[np.ndarray, np.ndarray]:
    """Return centres and half sizes (n, 2) of boxes."""
    return np.array([box.centre for box in boxes]), np.array([box.half for box in boxes])


def _covered(boxes: Sequence[Box], discs: Discs) -> np.ndarray:
    """Return how many discs each box touches."""
    centres, halves = _shape(boxes)
    beyond = np.maximum(np.abs(discs.centres - centres[:, None]) - halves[:, None], 0.0)
    return (np.hypot(beyond[..., 0], beyond[..., 1]) < discs.radii).sum(axis=1)


def _leaders(boxes: Sequence[Box], points: np.ndarray) -> np.ndarray:
    """Return points (n, LEADER, 2) along the lines from points, (2,) or (n, 2), to boxes."""
    anchors = np.array([box.anchor for box in boxes])
    share = np.linspace(0.0, 1.0, LEADER)[:, None]
    start = np.broadcast_to(points, anchors.shape)[:, None]
    return start + share * (anchors[:, None] - start)


def _passed(boxes: Sequence[Box], point: np.ndarray, markers: Discs) -> np.ndarray:
    """Return how many markers the line from a point to each box passes, without those in which the point lies."""
    elsewhere = np.linalg.norm(markers.centres - point, axis=1) > markers.radii
    gaps = _leaders(boxes, point)[:, :, None] - markers.centres[elsewhere]
    return (np.hypot(gaps[..., 0], gaps[..., 1]) < markers.radii[elsewhere]).any(axis=1).sum(axis=1)


def _crossed(boxes: Sequence[Box], point: np.ndarray, lines: Discs, near: float) -> np.ndarray:
    """Return how many points of the line from a point to each box lie on lines of the drawing, not near the point."""
    leaders = _leaders(boxes, point)
    gap, nearest = cKDTree(lines.centres).query(leaders)
    return ((gap < lines.radii[nearest]) & (np.linalg.norm(leaders - point, axis=2) > near)).sum(axis=1)


def _of_others(boxes: Sequence[Box], point: np.ndarray, others: Sequence[tuple[Box, np.ndarray]]) -> np.ndarray:
    """Return the cost of each box by the labels and the lines of others."""
    if not others:
        return np.zeros(len(boxes))
    placed = [box for box, _ in others]
    (centres, halves), (other_centres, other_halves) = _shape(boxes), _shape(placed)
    meets = (np.abs(other_centres - centres[:, None]) < other_halves + halves[:, None]).all(axis=2).sum(axis=1)
    own = _leaders(boxes, point)[:, :, None]
    passed = (np.abs(own - other_centres) < other_halves).all(axis=3).any(axis=1).sum(axis=1)
    theirs = _leaders(placed, np.array([start for _, start in others]))
    crossed = (np.abs(theirs - centres[:, None, None]) < halves[:, None, None]).all(axis=3).any(axis=2).sum(axis=1)
    return COVERED * meets + PASSED * (passed + crossed)
