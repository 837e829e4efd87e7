"""Closed triangulated surface of one piece: marching cubes on the signed distance, cut flat at the caps."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.implicit import SignedDistance
from coronaryuq.flow3d.mesh.geometry.paths import Cap

BLOCK = 6
"""Grid cells along the edge of a block: larger blocks waste points far off the surface, smaller ones share more."""

SNAP = 0.3
"""Vertices nearer to a cap's plane than this, in grid spacings, move into it, so that the cut leaves no tiny edges."""

SHORT = 0.5
"""Edges of a rim below this many grid spacings are collapsed."""

UPRIGHT = 0.2
"""Smallest cosine between a triangle's normal and the surface's, after vertices have moved at a cap."""

WALL = 1
"""Reference of wall triangles; cap number i has i + 2."""


def surface(implicit: SignedDistance, caps: Sequence[Cap], spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (n, 3), outward triangles (m, 3) and references (m,) of a closed surface cut at `caps`.

    spacing: of the grid, cm; below the smallest radius. Raises `MeshError`, naming the cap that could not be cut.
    """
    points, triangles = isosurface(implicit, spacing)
    refs = np.full(len(triangles), WALL)
    for index, cap in enumerate(caps):
        points, triangles, refs = cut(points, triangles, refs, index + 2, cap, implicit, spacing)
    points, triangles, refs = _largest(points, triangles, refs)
    if enclosed_volume(points, triangles) < 0.0:
        triangles = triangles[:, ::-1]
    return points, triangles, refs


def isosurface(implicit: SignedDistance, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Run marching cubes block by block and weld the vertices by grid edge; they lie on the true surface."""
    from skimage.measure import marching_cubes

    vertices, faces, keys = [], [], []
    count = 0
    for corner, values in implicit.blocks(spacing, BLOCK):
        # A value of exactly zero would put vertices of several edges on one grid point.
        values[np.abs(values) < 1e-6 * spacing] = 1e-6 * spacing
        if values.min() > 0.0 or values.max() < 0.0:
            continue
        local, triangles, _, _ = marching_cubes(values, 0.0)
        base = np.floor(local + 1e-6 * (local % 1.0 == 0.0)).astype(np.int64)
        axis = np.argmax(local - base, axis=1)
        vertices.append(local + corner)
        faces.append(triangles.astype(np.int64) + count)
        keys.append(np.column_stack([base + corner, axis]))
        count += len(local)
    if not vertices:
        raise MeshError("the vessels enclose nothing on this grid")
    _, first, new = np.unique(np.vstack(keys), axis=0, return_index=True, return_inverse=True)
    points = implicit.origin(spacing) + spacing * np.vstack(vertices)[first]
    triangles = new.reshape(-1)[np.vstack(faces)]
    triangles = triangles[_whole(triangles)]
    return implicit.project(points, 1e-2 * spacing, iterations=2), triangles


def cut(points, triangles, refs, ref: int, cap: Cap, implicit: SignedDistance, spacing: float):
    """Return the surface without what lies beyond a cap, closed by a fan of triangles with reference `ref`."""
    height = (points - cap.centre) @ cap.normal
    near = np.linalg.norm(points - cap.centre, axis=1) < 2.0 * cap.radius + 2.0 * spacing
    snapped = near & (np.abs(height) < SNAP * spacing)
    # Another vessel may cross the plane of a wide cap nearby.
    beside = triangles[_beyond(points, triangles, height, cap)[triangles].any(axis=1)]
    snapped &= np.isin(np.arange(len(points)), beside)
    outward = np.zeros_like(points)
    outward[near] = implicit.gradient(points[near], 1e-2 * spacing)
    places = _into_plane(points[snapped], cap, implicit, spacing)
    points, snapped = _snapped(points, triangles, snapped, height, places, outward)
    height[snapped] = 0.0
    beyond = _beyond(points, triangles, height, cap)
    side = np.where(beyond, height, -1.0)
    side[~beyond] = np.minimum(height[~beyond], 0.0)
    above = (side > 0.0)[triangles]
    stays = ~above.any(axis=1) & ~(snapped[triangles].all(axis=1))
    kept, kept_refs, clipped, clipped_refs = triangles[stays], refs[stays], [], []
    crossings: dict[tuple[int, int], int] = {}
    fresh: list[np.ndarray] = []

    def crossing(low: int, high: int) -> int:
        key = (low, high)
        if key not in crossings:
            share = height[low] / (height[low] - height[high])
            crossings[key] = len(points) + len(fresh)
            fresh.append(points[low] + share * (points[high] - points[low]))
        return crossings[key]

    mixed = above.any(axis=1) & ~(side >= 0.0)[triangles].all(axis=1)
    for triangle, old in zip(triangles[mixed].tolist(), refs[mixed].tolist(), strict=True):
        polygon = []
        for start, end in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            if side[start] <= 0.0:
                polygon.append(start)
            if side[start] * side[end] < 0.0:
                polygon.append(crossing(*sorted((start, end), key=lambda v: side[v])))
        for second, third in zip(polygon[1:-1], polygon[2:], strict=True):
            clipped.append([polygon[0], second, third])
            clipped_refs.append(old)
    in_plane = np.r_[snapped, np.ones(len(fresh), bool)]
    if fresh:
        added = _into_plane(np.array(fresh), cap, implicit, spacing)
        points = np.vstack([points, added])
        outward = np.vstack([outward, implicit.gradient(added, 1e-2 * spacing)])
    open_triangles = np.vstack([kept, np.array(clipped, np.int64).reshape(-1, 3)])
    open_refs = np.concatenate([kept_refs, np.array(clipped_refs, np.int64)])
    beside = in_plane[open_triangles].any(axis=1)
    border, border_refs = _without_short_rim(
        points, outward, open_triangles[beside], open_refs[beside], in_plane, cap, SHORT * spacing
    )
    rim = _rim(border, in_plane, cap)
    centre = points[rim].mean(axis=0)
    fan = np.column_stack([np.roll(rim, -1), rim, np.full(len(rim), len(points))])
    _check_cap(points[rim], centre, cap)
    return (
        np.vstack([points, centre]),
        np.vstack([open_triangles[~beside], border, fan]),
        np.concatenate([open_refs[~beside], border_refs, np.full(len(fan), ref)]),
    )


def _snapped(points, triangles, chosen: np.ndarray, height: np.ndarray, places: np.ndarray, outward: np.ndarray):
    """Move chosen points to their places unless a triangle below the plane would flip; return points and choice.

    outward: the surface's normal at every point near the cap.
    """
    moved, chosen = points.copy(), chosen.copy()
    moved[chosen] = places
    triangles = triangles[chosen[triangles].any(axis=1)]
    up = outward[triangles].sum(axis=1)
    while True:
        below = (~chosen & (height < 0.0))[triangles].any(axis=1) & chosen[triangles].any(axis=1)
        fallen = below & (_cosine(moved[triangles], up) < UPRIGHT)
        if not fallen.any():
            return moved, chosen
        back = np.unique(triangles[fallen])
        moved[back], chosen[back] = points[back], False


def _cosine(corners: np.ndarray, up: np.ndarray) -> np.ndarray:
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(up, axis=1)
    return (normal * up).sum(axis=1) / np.maximum(size, 1e-300)


def _into_plane(points: np.ndarray, cap: Cap, implicit: SignedDistance, spacing: float) -> np.ndarray:
    """Return points moved into the cap's plane and, within it, onto the surface."""
    points = points - ((points - cap.centre) @ cap.normal)[:, None] * cap.normal
    for _ in range(3):
        slope = implicit.gradient(points, 1e-2 * spacing)
        slope -= (slope @ cap.normal)[:, None] * cap.normal
        steep = np.maximum(np.einsum("ij,ij->i", slope, slope), 0.25)
        points = points - (implicit.distance(points) / steep)[:, None] * slope
    return points


def _beyond(points, triangles, height, cap: Cap) -> np.ndarray:
    """Return the vertices of the connected part of the surface that lies beyond the cap around its axis."""
    above = height > 0.0
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = edges[above[edges].all(axis=1)]
    n = len(points)
    _, label = connected_components(coo_array((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)
    start = cap.centre + 0.5 * cap.radius * cap.normal
    candidates = np.flatnonzero(above)
    if not len(candidates):
        raise MeshError(f"cap {cap.name} cuts nothing")
    tip = candidates[np.argmin(np.linalg.norm(points[candidates] - start, axis=1))]
    beyond = above & (label == label[tip])
    if np.linalg.norm(points[beyond] - cap.centre, axis=1).max() > 4.0 * cap.radius:
        raise MeshError(f"cap {cap.name} is too close to another vessel, or its centreline bends back there")
    return beyond


def _rim(triangles: np.ndarray, in_plane: np.ndarray, cap: Cap) -> np.ndarray:
    """Return the edge of the triangles in the cap's plane as one loop of vertices in the triangles' sense."""
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = edges[in_plane[edges].all(axis=1)]
    n = len(in_plane)
    unpaired = ~np.isin(edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0])
    onward = dict(edges[unpaired].tolist())
    if not onward:
        raise MeshError(f"cap {cap.name} cuts nothing")
    loop = [min(onward)]
    while (following := onward.get(loop[-1])) not in (None, loop[0]):
        loop.append(following)
        if len(loop) > len(onward):
            break
    if len(loop) != len(onward):
        raise MeshError(f"cap {cap.name} has a rim of more than one loop: another vessel is too close")
    return np.array(loop)


def _without_short_rim(points, outward, triangles, refs, in_plane: np.ndarray, cap: Cap, shortest: float):
    """Collapse rim edges below `shortest` where the surface stays manifold: mmgs would keep them."""
    rim = _rim(triangles, in_plane, cap).tolist()
    position = 0
    while position < len(rim) and len(rim) > 12:
        here, onward = rim[position], rim[(position + 1) % len(rim)]
        short = np.linalg.norm(points[here] - points[onward]) < shortest
        ways = [(here, onward), (onward, here)] if short else []
        goes = next((goes for stays, goes in ways if _may_collapse(points, outward, triangles, stays, goes)), None)
        if goes is None:
            position += 1
            continue
        triangles = np.where(triangles == goes, here if goes == onward else onward, triangles)
        whole = _whole(triangles)
        triangles, refs = triangles[whole], refs[whole]
        rim.remove(goes)
        position -= position >= len(rim)
    return triangles, refs


def _may_collapse(points: np.ndarray, outward: np.ndarray, triangles: np.ndarray, stays: int, goes: int) -> bool:
    """Return whether an edge of the rim can be collapsed without harm.

    The two vertices share one neighbour, that of their one triangle (link condition), and no triangle flips.
    """
    around = [set(np.unique(triangles[(triangles == v).any(axis=1)]).tolist()) for v in (stays, goes)]
    if len((around[0] & around[1]) - {stays, goes}) != 1:
        return False
    before = triangles[(triangles == goes).any(axis=1) & ~(triangles == stays).any(axis=1)]
    up = outward[before].sum(axis=1)
    old, new = (_cosine(points[corners], up) for corners in (before, np.where(before == goes, stays, before)))
    # Slivers of the isosurface may have been tilted before.
    return not ((new < UPRIGHT) & (new < old)).any()


def _whole(triangles: np.ndarray) -> np.ndarray:
    """Return which triangles have three different corners, (m,)."""
    return np.all(np.diff(np.sort(triangles, axis=1), axis=1) > 0, axis=1)


def _check_cap(rim: np.ndarray, centre: np.ndarray, cap: Cap) -> None:
    area = 0.5 * np.linalg.norm(np.cross(rim - centre, np.roll(rim, -1, axis=0) - centre).sum(axis=0))
    ratio = area / (np.pi * cap.radius**2)
    if not 0.6 < ratio < 1.5:
        raise MeshError(
            f"cap {cap.name} has {ratio:.2f} times the area of its vessel: it touches another vessel, or the "
            "centreline bends there"
        )


def _largest(points: np.ndarray, triangles: np.ndarray, refs: np.ndarray):
    """Return the connected part with most triangles, renumbered."""
    n = len(points)
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    _, label = connected_components(coo_array((np.ones(len(edges)), edges.T), shape=(n, n)), directed=False)
    largest = label[triangles[:, 0]] == np.bincount(label[triangles[:, 0]]).argmax()
    used, new = np.unique(triangles[largest], return_inverse=True)
    return points[used], new.reshape(-1, 3), refs[largest]


def enclosed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume inside a closed surface of outward triangles, cm3."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6.0)
