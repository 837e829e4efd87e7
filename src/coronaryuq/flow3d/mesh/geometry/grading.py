"""Node placement: closer to the wall at a throat, and wall nodes so that flat facets enclose the true lumen."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit, SignedDistance
from coronaryuq.flow3d.mesh.geometry.paths import narrowed

_MIDDLES = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])


class Grading:
    """Draw inner nodes to the wall: depth d becomes R (d/R)^e, R from axis to wall, e = 1 + strength at a throat.

    Towards the ends of a stenosis the exponent falls to 1, with the radius lost. Elements at a throat's wall become
    thinner, and none is added.
    """

    def __init__(self, implicit: Implicit, stenoses: Sequence[Stenosis], strength: float):
        self._implicit, self._strength, self._share = implicit, strength, []
        for path in implicit.paths:
            share = np.zeros(len(path.radii))
            for stenosis in stenoses:
                within, lost = narrowed(path, stenosis)
                share[within] = np.maximum(share[within], lost)
            self._share.append(share)

    def __call__(self, points: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return new positions (m, 3) of points (m, 3) that lie `depth` (m,) below the wall, cm."""
        path, segment, along = self._implicit.nearest(points)
        share, axis = np.zeros(len(points)), points.copy()
        for index, values in enumerate(self._share):
            own = np.flatnonzero(path == index)
            first, t = segment[own], along[own]
            share[own] = values[first] * (1.0 - t) + values[first + 1] * t
            line = self._implicit.paths[index].points
            axis[own] = line[first] * (1.0 - t)[:, None] + line[first + 1] * t[:, None]
        out = points - axis
        off = np.linalg.norm(out, axis=1)
        radius = off + depth
        inside = (depth > 0.0) & (off > 0.0) & (share > 0.0)
        moved = np.array(points)
        d, r = depth[inside], radius[inside]
        rise = d - r * (d / r) ** (1.0 + self._strength * share[inside])
        moved[inside] += (rise / off[inside])[:, None] * out[inside]
        return moved


def stand_off(
    points: np.ndarray, triangles: np.ndarray, implicit: SignedDistance, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return wall nodes (k,) and positions (k, 3) at which their flat triangles enclose the true volume.

    A flat triangle with its corners on a tube lies inside by its sagitta, h²/16R on average, which takes (h/R)²/8 of
    the lumen's area and adds (h/R)²/4 to its resistance. Each node is moved out by the mean depth of its triangles.
    """
    corners = points[triangles]
    depth = -np.mean([implicit.distance(weight @ corners) for weight in _MIDDLES], axis=0)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    nodes, local = np.unique(triangles, return_inverse=True)
    local = local.ravel()
    off = np.bincount(local, np.repeat(area * depth, 3)) / np.bincount(local, np.repeat(area, 3))
    slope = implicit.gradient(points[nodes], step)
    length = np.linalg.norm(slope, axis=1)
    return nodes, points[nodes] + (off / np.maximum(length, 0.5))[:, None] * slope
