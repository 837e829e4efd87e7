"""Vessels as an implicit surface: signed distance to tapered capsules along paths, blended where paths meet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from coronaryuq.core.jit import njit

CHUNK = 8
FAR = 1e9
STEEPEST = 1.5
"""Bound on the slope of the distance: 1 for a tube, more where the radius changes along it."""
SHARPEST = 0.7
"""Curvature of an axis times its radius, above which it counts as a corner: at 1 the nearest point is not unique."""


class SignedDistance(Protocol):
    """A lumen as a signed distance, negative inside: `Implicit` from centrelines, `Lumen` from a closed surface."""

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance (m,) at points (m, 3), cm."""

    def gradient(self, points: np.ndarray, step: float) -> np.ndarray:
        """Return central differences of the distance, (m, 3)."""

    def project(self, points: np.ndarray, step: float, iterations: int = 3) -> np.ndarray:
        """Return points moved onto the surface, (m, 3)."""

    def blocks(self, spacing: float, cells: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the cubes of `cells` grid cells that the surface may cross.

        Index of the first grid point (3,) and the distance at the (cells + 1)³ points; grid point (i, j, k) lies at
        `origin(spacing) + spacing (i, j, k)`.
        """

    def origin(self, spacing: float) -> np.ndarray:
        """Return the lower corner of the grid (3,), cm."""


@dataclass(frozen=True)
class Path:
    """A centreline through consecutive vessels: points (n, 3) and radii (n,), cm.

    vessel (n,): each point's vessel; arc (n,): arc length along it; blend: width in cm over which the path merges
    smoothly with those listed before it.
    """

    points: np.ndarray
    radii: np.ndarray
    vessel: np.ndarray
    arc: np.ndarray
    blend: float


class Implicit:
    """Signed distance, negative inside, to the union of paths of tapered tubes, with a C1 blend (Quilez 2013).

    On each part of a path it is the distance to the nearest point of the axis minus the radius there, so that a
    straight axis gives exactly the radii; where the part folds back, the fold in which the point lies deepest counts.
    Parts end where vessels do and where the axis has a corner: beside a corner the nearest point jumps from one side of
    it to the other, and with it the radius, so that the distance would jump too and the surface would cut itself.
    """

    def __init__(self, paths: Sequence[Path]):
        self.paths = list(paths)
        a, b, ra, rb, first, part, blend = [], [], [], [], [0], [0], []
        for path in paths:
            a.append(path.points[:-1])
            b.append(path.points[1:])
            near, far = path.radii[:-1].copy(), path.radii[1:]
            joints = np.flatnonzero(path.vessel[1:-1] != path.vessel[2:]) + 1
            # A daughter starts with its own radius: a cone from the parent's radius would be too steep.
            near[joints] = far[joints]
            starts = np.union1d(joints, corners(path))
            ra.append(near)
            rb.append(far)
            part += [first[-1] + k for k in starts] + [first[-1] + len(near)]
            blend += [path.blend, *np.abs(near[starts] - far[starts - 1])]
            first.append(part[-1])
        self.a, self.b = np.vstack(a), np.vstack(b)
        self.ra, self.rb = np.concatenate(ra), np.concatenate(rb)
        self.first = np.array(first)
        self.part, self.blend = np.array(part, np.int64), np.array(blend, float)
        self.bounds, self.bound_first = _bounds(self.a, self.b, self.ra, self.rb, self.part)

    def _arrays(self):
        return self.a, self.b, self.ra, self.rb, self.part, self.blend, self.bounds, self.bound_first

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance (m,) at points (m, 3), cm."""
        return _evaluate(np.ascontiguousarray(points, float), *self._arrays())[0]

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the path, the segment within it and the position along it in [0, 1] that own each point, (m,)."""
        _, segment, along = _evaluate(np.ascontiguousarray(points, float), *self._arrays())
        path = np.searchsorted(self.first, segment, side="right") - 1
        return path, segment - self.first[path], along

    def gradient(self, points: np.ndarray, step: float) -> np.ndarray:
        """Return central differences of the distance, (m, 3)."""
        shifts = step * np.eye(3)
        return np.column_stack([(self.distance(points + h) - self.distance(points - h)) / (2.0 * step) for h in shifts])

    def project(self, points: np.ndarray, step: float, iterations: int = 3) -> np.ndarray:
        """Move points onto the surface by Newton steps along the gradient, (m, 3)."""
        points = np.array(points, float)
        for _ in range(iterations):
            slope = self.gradient(points, step)
            steep = np.maximum(np.einsum("ij,ij->i", slope, slope), 0.25)
            points -= (self.distance(points) / steep)[:, None] * slope
        return points

    def blocks(self, spacing: float, cells: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the cubes that the surface may cross; see `SignedDistance.blocks`."""
        low = self.origin(spacing)
        high = np.maximum(self.a + self.ra[:, None], self.b + self.rb[:, None]).max(axis=0) + 3.0 * spacing
        count = np.ceil((high - low) / (cells * spacing)).astype(int)
        corners = cells * np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 3)
        reach = 0.5 * np.sqrt(3.0) * cells * spacing
        centres = low + spacing * (corners + 0.5 * cells)
        crossed = np.abs(self.distance(centres)) < STEEPEST * reach
        for corner, centre in zip(corners[crossed], centres[crossed], strict=True):
            yield corner, _block(low + spacing * corner, spacing, cells + 1, centre, reach, *self._arrays())

    def origin(self, spacing: float) -> np.ndarray:
        """Return the lower corner of the grid (3,), cm."""
        return np.minimum(self.a - self.ra[:, None], self.b - self.rb[:, None]).min(axis=0) - 3.0 * spacing


def corners(path: Path) -> np.ndarray:
    """Return the inner points of a path (k,) at which its axis turns by more than `SHARPEST` within one radius."""
    along = np.diff(path.points, axis=0)
    length = np.linalg.norm(along, axis=1)
    cosine = (along[1:] * along[:-1]).sum(axis=1) / (length[1:] * length[:-1])
    turn = np.arccos(np.clip(cosine, -1.0, 1.0))
    spacing = 0.5 * (length[1:] + length[:-1])
    return np.flatnonzero(turn * path.radii[1:-1] > SHARPEST * spacing) + 1


def _bounds(a, b, ra, rb, first):
    """Return bounding spheres (x, y, z, R) of runs of `CHUNK` segments, so that distant runs are skipped."""
    spheres, index = [], [0]
    for low, high in zip(first[:-1], first[1:], strict=True):
        for start in range(low, high, CHUNK):
            stop = min(start + CHUNK, high)
            ends = np.vstack([a[start:stop], b[start:stop]])
            centre = 0.5 * (ends.min(axis=0) + ends.max(axis=0))
            radii = np.r_[ra[start:stop], rb[start:stop]]
            spheres.append([*centre, np.max(np.linalg.norm(ends - centre, axis=1) + radii), start, stop])
        index.append(len(spheres))
    return np.array(spheres), np.array(index)


@njit(cache=True)
def _foot(x, y, z, a, b):
    """Return the distance from a point to a segment, and the position of the foot along it."""
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    px, py, pz = x - a[0], y - a[1], z - a[2]
    t = (px * ex + py * ey + pz * ez) / (ex * ex + ey * ey + ez * ez)
    t = min(1.0, max(0.0, t))
    qx, qy, qz = px - t * ex, py - t * ey, pz - t * ez
    return np.sqrt(qx * qx + qy * qy + qz * qz), t


@njit(cache=True)
def _at(x, y, z, a, b, ra, rb, first, blend, bounds, bound_first):
    """Return the distance at one point, the segment that owns it, and the position along that segment."""
    total, owner, owner_along = FAR, -1, 0.0
    for part in range(len(first) - 1):
        # A part beyond the reach of its blend changes nothing.
        best, segment = total + blend[part], -1
        for k in range(bound_first[part], bound_first[part + 1]):
            dx, dy, dz = x - bounds[k, 0], y - bounds[k, 1], z - bounds[k, 2]
            if np.sqrt(dx * dx + dy * dy + dz * dz) - bounds[k, 3] >= best:
                continue
            for i in range(int(bounds[k, 4]), int(bounds[k, 5])):
                away, t = _foot(x, y, z, a[i], b[i])
                d = away - (ra[i] + t * (rb[i] - ra[i]))
                if d < best:
                    best, segment = d, i
        if segment < 0:
            continue
        away, along = _foot(x, y, z, a[segment], b[segment])
        for step in (-1, 1):
            i = segment + step
            while first[part] <= i < first[part + 1]:
                nearer, t = _foot(x, y, z, a[i], b[i])
                if nearer >= away:
                    break
                away, along, segment = nearer, t, i
                i += step
        best = away - (ra[segment] + along * (rb[segment] - ra[segment]))
        if best < total:
            owner, owner_along = segment, along
        overlap = max(0.0, blend[part] - abs(total - best))
        total = min(total, best)
        if overlap > 0.0:
            total -= overlap * overlap / (4.0 * blend[part])
    return total, owner, owner_along


@njit(cache=True)
def _evaluate(points, a, b, ra, rb, first, blend, bounds, bound_first):
    n = len(points)
    distance, segment, along = np.empty(n), np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        distance[i], segment[i], along[i] = _at(
            points[i, 0], points[i, 1], points[i, 2], a, b, ra, rb, first, blend, bounds, bound_first
        )
    return distance, segment, along


@njit(cache=True)
def _block(low, spacing, n, centre, reach, a, b, ra, rb, first, blend, bounds, bound_first):
    """Return the distance at n³ grid points, skipping runs of segments that cannot be nearest anywhere in the block."""
    near_bounds = np.empty_like(bounds)
    near_first = np.zeros(len(bound_first), np.int64)
    for part in range(len(first) - 1):
        own = np.array([0, bound_first[part + 1] - bound_first[part]])
        chunk = bounds[bound_first[part] : bound_first[part + 1]]
        ends = np.array([0, 1])
        here = _at(centre[0], centre[1], centre[2], a, b, ra, rb, ends, blend[part : part + 1], chunk, own)[0]
        count = near_first[part]
        for k in range(len(chunk)):
            away = np.sqrt(
                (centre[0] - chunk[k, 0]) ** 2 + (centre[1] - chunk[k, 1]) ** 2 + (centre[2] - chunk[k, 2]) ** 2
            )
            if away - chunk[k, 3] <= here + 3.0 * reach:
                near_bounds[count] = chunk[k]
                count += 1
        near_first[part + 1] = count
    values = np.empty((n, n, n))
    for i in range(n):
        for j in range(n):
            for k in range(n):
                values[i, j, k] = _at(
                    low[0] + spacing * i, low[1] + spacing * j, low[2] + spacing * k,
                    a, b, ra, rb, first, blend, near_bounds, near_first,
                )[0]  # fmt: skip
    return values
