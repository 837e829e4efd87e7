"""Mean of a nodal field over a flat cross-section of the lumen, as weights on nodes."""

import numpy as np
from scipy.sparse.csgraph import connected_components

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.fem.elements import assemble

_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def section_weights(
    points: np.ndarray, tets: np.ndarray, centre: np.ndarray, normal: np.ndarray, name: str = "plane"
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return nodes and weights of the area mean over a plane cross-section of the lumen.

    A plane may cut other vessels too: only the connected part of the cut nearest to `centre` counts. Exact for fields
    that are linear in each tetrahedron.

    Parameters
    ----------
    points, tets
        (n, 3) nodes in cm and (m, 4) tetrahedra.
    centre, normal
        (3,) a point of the plane, cm, and its normal.
    name
        The plane's name in errors.

    Returns
    -------
    tuple
        Nodes (k,), weights (k,) that sum to one, and the area in cm2.

    Raises
    ------
    InputError
        The plane misses the mesh.
    """
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    height = (points - centre) @ normal
    above = height[tets] >= 0.0
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    if not len(cut):
        raise InputError("mesh.json", f"planes.{name}", None, "the plane does not cut the mesh; regenerate the mesh")
    here = tets[cut]
    used, local = np.unique(here, return_inverse=True)
    local = local.reshape(here.shape)
    joined = assemble(local, np.ones((len(cut), 4, 4)), len(used))
    _, label = connected_components(joined, directed=False)
    distance = np.linalg.norm(points[used] - centre, axis=1)
    near = label[np.argmin(distance)]
    weight = np.zeros(len(points))
    for tet in here[label[local[:, 0]] == near]:
        corners = [
            _crossing(points, height, tet[a], tet[b])
            for a, b in _EDGES
            if (height[tet[a]] >= 0) != (height[tet[b]] >= 0)
        ]
        for triangle in _triangles(corners, normal):
            vector = np.cross(triangle[1][0] - triangle[0][0], triangle[2][0] - triangle[0][0])
            third = np.linalg.norm(vector) / 6.0
            for _, a, b, share in triangle:
                weight[a] += third * (1.0 - share)
                weight[b] += third * share
    area = weight.sum()
    nodes = np.flatnonzero(weight)
    return nodes, weight[nodes] / area, float(area)


def _crossing(points, height, a, b):
    share = height[a] / (height[a] - height[b])
    return points[a] + share * (points[b] - points[a]), a, b, share


def _triangles(corners, normal):
    if len(corners) == 3:
        return [corners]
    middle = np.mean([corner[0] for corner in corners], axis=0)
    first = corners[0][0] - middle
    second = np.cross(normal, first)
    corners = sorted(corners, key=lambda c: np.arctan2((c[0] - middle) @ second, (c[0] - middle) @ first))
    return [corners[:3], [corners[0], corners[2], corners[3]]]
