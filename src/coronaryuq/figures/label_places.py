"""Where the labels of a drawing go: beside their points, clear of one another and of the lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

NEAR, STEP, RINGS = 0.035, 0.03, 8
"""Distances of a label from its point over the extent of the drawing: the smallest, between two, and how many."""
DIRECTIONS = 16
COVERED, PASSED, FAR, INWARDS = 20.0, 4.0, 0.35, 0.25
"""Costs of a label: for each label that it covers; for each one that its line passes; for each step from its point;
for a full turn inwards. A point of a line that it covers costs 1."""


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
    def corners(self) -> np.ndarray:
        """Lower left and upper right corner (2, 2)."""
        half = np.array([0.0, self.height / 2])
        return np.array([[self.left, self.middle] - half, [self.left + self.width, self.middle] + half])

    def covers(self, points: np.ndarray) -> np.ndarray:
        """Return which of the points (n, 2) lie in the box."""
        across = (points[:, 0] > self.left) & (points[:, 0] < self.left + self.width)
        return across & (np.abs(points[:, 1] - self.middle) < self.height / 2)

    def meets(self, other: "Box") -> bool:
        """Return whether two boxes overlap."""
        across = self.left < other.left + other.width and other.left < self.left + self.width
        return across and abs(self.middle - other.middle) < (self.height + other.height) / 2


def place_labels(
    points: np.ndarray, sizes: Sequence[tuple[float, float]], lines: np.ndarray, extent: float
) -> list[Box]:
    """Return a box for each label, one after another, each where it costs least.

    Parameters
    ----------
    points
        (n, 2) points that are labelled.
    sizes
        Width and height of each label.
    lines
        (m, 2) points along the lines of the drawing, evenly spaced.
    extent
        Extent of the drawing.
    """
    centre = points.mean(axis=0)
    boxes: list[Box] = []
    for point, (width, height) in zip(points, sizes, strict=True):
        away = (point - centre) / max(float(np.linalg.norm(point - centre)), 1e-9)
        best: tuple[float, Box] | None = None
        for ring in range(RINGS):
            for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
                towards = np.array([np.cos(angle), np.sin(angle)])
                x, y = point + (NEAR + ring * STEP) * extent * towards
                box = Box(x if towards[0] >= 0 else x - width, y, width, height, bool(towards[0] >= 0))
                cost = FAR * ring + INWARDS * (1 - float(towards @ away)) / 2 + _cost(box, point, boxes, points, lines)
                if best is None or cost < best[0] - 1e-9:
                    best = cost, box
        assert best is not None
        boxes.append(best[1])
    return boxes


def _cost(box: Box, point: np.ndarray, boxes: list[Box], points: np.ndarray, lines: np.ndarray) -> float:
    leader = point + np.linspace(0.0, 1.0, 12)[:, None] * (box.anchor - point)
    passed = sum(bool(other.covers(leader).any()) for other in boxes)
    covered = sum(box.meets(other) for other in boxes)
    return COVERED * covered + PASSED * passed + float(box.covers(lines).sum()) + 2.0 * float(box.covers(points).sum())
