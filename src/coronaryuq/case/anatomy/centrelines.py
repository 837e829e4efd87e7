"""Centrelines and radii of a closed lumen: shortest paths through its medial axis (Antiga et al. 2003, 2008)."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay, cKDTree

from coronaryuq.case.anatomy.surface import Cap, Surface
from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel
from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator

MOST_POINTS = 60_000
"""Maximum number of surface points for the medial axis; more are thinned evenly."""
JITTER = 1e-3
"""Spacings by which points of the surface are moved at random. Of points on a lattice, as a segmentation leaves them,
many lie on one sphere: rounding decides which are neighbours, and flat tetrahedra, without a centre, part the axis."""
COST_POWER = 2.0
"""The cost of a step is its length divided by this power of the radius, so that paths keep to the middle."""
SPACING = 0.25
"""Spacing of centreline points, in local radii."""
SMOOTHING = 0.7
"""Standard deviation of the smoothing along a vessel, in local radii."""
REACH = 1.8
"""Extent of a vessel's cross-section, in radii of the ball inscribed in the lumen."""
MERGE = 1.0
"""A vessel between two bifurcations shorter than this many radii is merged: its ends become one junction."""


@dataclass(frozen=True)
class MedialAxis:
    """Voronoi vertices of the surface's points inside the lumen.

    points: (n, 3) cm. radius: (n,) cm, of the inscribed ball around each. graph: sparse (n, n) of step costs.
    """

    points: np.ndarray
    radius: np.ndarray
    graph: object


def medial_axis(surface: Surface, wanted: float) -> MedialAxis:
    """Compute the internal Voronoi diagram of points on the surface, about `wanted` (cm) apart.

    A Voronoi vertex is inside if it lies behind the surface at the points nearest to it.
    """
    sites, normals = _sites(surface, wanted)
    sites = sites + JITTER * wanted * generator(1, "medial axis").uniform(-1.0, 1.0, sites.shape)
    mesh = Delaunay(sites)
    corners = sites[mesh.simplices]
    edges = corners[:, 1:] - corners[:, :1]
    sound = np.abs(np.linalg.det(edges)) > 1e-12 * wanted**3
    centres = np.full((len(corners), 3), np.inf)
    right = (edges[sound] ** 2).sum(axis=2) / 2
    centres[sound] = corners[sound, 0] + np.linalg.solve(edges[sound], right[..., None])[..., 0]
    radius = np.linalg.norm(centres - corners[:, 0], axis=1)
    with np.errstate(invalid="ignore"):
        behind = ((centres[:, None] - corners) * normals[mesh.simplices]).sum(axis=2) < -0.2 * radius[:, None]
    inside = np.flatnonzero(sound & (radius > wanted / 2) & (behind.sum(axis=1) >= 3))
    number = np.full(len(corners), -1)
    number[inside] = np.arange(len(inside))
    points, radius = centres[inside], radius[inside]
    a, k = np.nonzero(mesh.neighbors >= 0)
    b = mesh.neighbors[a, k]
    both = (a < b) & (number[a] >= 0) & (number[b] >= 0)
    a, b = number[a[both]], number[b[both]]
    length = np.linalg.norm(points[a] - points[b], axis=1) + 1e-9
    cost = length * (0.5 / radius[a] ** COST_POWER + 0.5 / radius[b] ** COST_POWER)
    # A step is kept only if the two balls overlap: longer ones would cut through a wall.
    kept = length < radius[a] + radius[b]
    graph = coo_matrix((cost[kept], (a[kept], b[kept])), shape=(len(points),) * 2).tocsr()
    return MedialAxis(points, radius, graph)


def signed_distance(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Compute the distance (n,) cm of points (n, 3) from the surface, negative inside."""
    import pyvista as pv

    cloud = pv.PolyData(np.asarray(points, dtype=float))
    return np.asarray(cloud.compute_implicit_distance(surface.polydata())["implicit_distance"], dtype=float)


def _sites(surface: Surface, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points on the surface with outward normals: its own, plus more on long edges, thinned if too many."""
    polydata = surface.polydata()
    spacing = max(spacing, np.sqrt(2 * float(polydata.area) / MOST_POINTS))
    dense = polydata.subdivide_adaptive(max_edge_len=2 * spacing, max_n_passes=12)
    points, faces = np.asarray(dense.points, dtype=float), np.asarray(dense.regular_faces)
    a, b, c = (points[faces[:, k]] for k in range(3))
    cross, normals = np.cross(b - a, c - a), np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, faces[:, k], cross)
    points, first, again = np.unique(points, axis=0, return_index=True, return_inverse=True)
    summed = np.zeros_like(points)
    np.add.at(summed, again.ravel(), normals)
    normals = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-300)
    cell = spacing / 2
    while len(points) > MOST_POINTS:
        _, first = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_index=True)
        points, normals, cell = points[np.sort(first)], normals[np.sort(first)], cell * 1.3
    return points, normals


def centreline_tree(
    file: str | Path, surface: Surface, inlet: Cap, outlets: dict[str, Cap], spacing: float | None = None,
    root: str = AORTA, taken: Iterable[str] = (),
) -> Tree:  # fmt: skip
    """Trace the tree from the inlet to every other cap, radii in cm.

    Inner vessels are named `branchN` by their position in the tree, the first one `root`; branches are not labelled.
    Radii are those of discs with the areas of the cross-sections, as far out as `REACH`.

    Parameters
    ----------
    file : str or Path
        The surface's file, for error messages.
    surface : Surface
        The closed lumen.
    inlet : Cap
        The aortic inlet.
    outlets : dict of str to Cap
        Name of each end's vessel → its cap.
    spacing : float, optional
        Of the surface points, cm; by default a third of the smallest outlet radius.
    root : str
        Name of the first vessel.
    taken : iterable of str
        Names that inner vessels must not have; where they would, `_` is added.

    Raises
    ------
    InputError
        If a cap cannot be reached through the lumen.
    """
    axis = medial_axis(surface, spacing or min(cap.radius for cap in outlets.values()) / 3)
    kd = cKDTree(axis.points)
    source = _node_at(file, axis, kd, inlet)
    cost, before = dijkstra(axis.graph, directed=False, indices=source, return_predecessors=True)
    paths = {}
    for name, cap in outlets.items():
        target = _node_at(file, axis, kd, cap)
        if not np.isfinite(cost[target]):
            raise InputError(file, name, str(cap), "cannot be reached from the inlet through the lumen")
        path = [target]
        while path[-1] != source:
            path.append(int(before[path[-1]]))
        paths[name] = path[::-1]
    pieces = _pieces(axis, paths)
    return _tree(surface, axis, pieces, inlet, outlets, _names(pieces, root, {*taken, *outlets}))


def _node_at(file, axis: MedialAxis, kd: cKDTree, cap: Cap) -> int:
    """Return the node of largest radius about one radius inside a cap."""
    inner = cap.centre - 0.8 * cap.radius * cap.normal
    near = np.array(kd.query_ball_point(inner, 0.8 * cap.radius), dtype=int)
    if len(near) == 0:
        raise InputError(file, "cap", str(cap), "no lumen behind this cap; refine the surface there")
    return int(near[np.argmax(axis.radius[near])])


@dataclass
class _Piece:
    """A run of nodes between two bifurcations; `parent` is an index into the list of pieces."""

    nodes: list[int]
    parent: int | None
    name: str | None


def _pieces(axis: MedialAxis, paths: dict[str, list[int]]) -> list[_Piece]:
    """Cut the union of paths from one source into pieces, the first starting there; merge short inner pieces."""
    children: dict[int, list[int]] = {}
    ends = {path[-1]: name for name, path in paths.items()}
    for path in paths.values():
        for a, b in zip(path, path[1:], strict=False):
            if b not in children.setdefault(a, []):
                children[a].append(b)
    source = next(iter(paths.values()))[0]
    pieces: list[_Piece] = []
    open_runs: list[tuple[list[int], int | None]] = [([source], None)]
    while open_runs:
        run, parent = open_runs.pop(0)
        while len(children.get(run[-1], [])) == 1 and run[-1] not in ends:
            run.append(children[run[-1]][0])
        here, after = len(pieces), children.get(run[-1], [])
        name = ends.get(run[-1])
        pieces.append(_Piece(run, parent, None if after else name))
        if after and name is not None:
            # Other ends lie farther along, so this one gets a short piece of its own.
            pieces.append(_Piece([run[-1]], here, name))
        open_runs += [([run[-1], child], here) for child in after]
    return _merged(axis, pieces)


def _merged(axis: MedialAxis, pieces: list[_Piece]) -> list[_Piece]:
    """Remove inner pieces shorter than `MERGE` radii; their children start where they did."""
    while (k := _too_short(axis, pieces)) is not None:
        piece = pieces[k]
        for child in pieces:
            if child.parent == k:
                child.nodes, child.parent = piece.nodes + child.nodes[1:], piece.parent
        pieces = [p for j, p in enumerate(pieces) if j != k]
        for p in pieces:
            if p.parent is not None and p.parent > k:
                p.parent -= 1
    return pieces


def _too_short(axis: MedialAxis, pieces: list[_Piece]) -> int | None:
    for k, piece in enumerate(pieces):
        if piece.name is None and piece.parent is not None:
            length = np.linalg.norm(np.diff(axis.points[piece.nodes], axis=0), axis=1).sum()
            if length < MERGE * axis.radius[piece.nodes].mean():
                return k
    return None


def _names(pieces: list[_Piece], root: str, taken: set[str]) -> list[str]:
    names = []
    for k, piece in enumerate(pieces):
        name = piece.name
        if name is None:
            name = root if k == 0 else f"branch{k}"
            while name in taken:
                name += "_"
        names.append(name)
    return names


def _tree(
    surface: Surface, axis: MedialAxis, pieces: list[_Piece], inlet: Cap, outlets: dict[str, Cap], names: list[str]
) -> Tree:
    caps = {k: outlets[p.name] for k, p in enumerate(pieces) if p.name is not None}
    lines = []
    for k, piece in enumerate(pieces):
        points, radius = axis.points[piece.nodes], axis.radius[piece.nodes]
        if k == 0:
            points, radius = _up_to(points, radius, inlet, first=True)
        if k in caps:
            points, radius = _up_to(points, radius, caps[k], first=False)
        lines.append(_smoothed(points, radius))
    depth = -signed_distance(surface, np.concatenate([points for points, _ in lines]))
    inscribed = np.split(depth, np.cumsum([len(points) for points, _ in lines])[:-1])
    cut = _Slicer(surface)
    vessels = []
    for k, (points, ball) in enumerate(zip([p for p, _ in lines], inscribed, strict=True)):
        radius = np.maximum(ball, 1e-3)
        if k == 0:
            radius[0] = inlet.radius
        if k in caps:
            # At a cap the inscribed ball shrinks to zero, but the lumen does not.
            arc = np.linalg.norm(points - points[-1], axis=1)
            radius = np.where(arc < caps[k].radius, np.maximum(radius, caps[k].radius), radius)
        if k == 0:
            arc = np.linalg.norm(points - points[0], axis=1)
            radius = np.where(arc < inlet.radius, np.maximum(radius, inlet.radius), radius)
        inner = slice(1 if k == 0 else 0, -1 if k in caps else None)
        radius[inner] = cut.area_radii(points, radius)[inner]
        parent = pieces[k].parent
        if parent is not None:
            radius = own_radius(points, radius, float(lines[parent][1][-1]))
        vessels.append(Vessel(names[k], points, radius, None if parent is None else names[parent], AORTA))
    return Tree(vessels)


def own_radius(points: np.ndarray, radius: np.ndarray, parent_radius: float) -> np.ndarray:
    """Replace radii inside the parent's lumen, where a vessel starts, by the radius with which it leaves.

    It leaves at one parent's radius from its start, or farther along where its radius stops falling.
    """
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    out = min(int(np.searchsorted(arc, parent_radius)), len(radius) - 1)
    if parent_radius > 2 * np.median(radius[out:]):
        while out < len(radius) - 1 and radius[out + 1 : out + 4].min() < 0.98 * radius[out]:
            out += 1
    return np.concatenate([np.minimum(radius[:out], radius[out]), radius[out:]])


def _up_to(points: np.ndarray, radius: np.ndarray, cap: Cap, first: bool) -> tuple[np.ndarray, np.ndarray]:
    """Replace the part of the line within one radius of a cap by the cap's centre."""
    far = (cap.centre - points) @ cap.normal > 0.9 * cap.radius
    if first:
        begin = int(np.argmax(far)) if far.any() else len(points) - 1
        return np.vstack([cap.centre, points[begin:]]), np.concatenate([[cap.radius], radius[begin:]])
    end = len(far) - int(np.argmax(far[::-1])) if far.any() else 1
    return np.vstack([points[:end], cap.centre]), np.concatenate([radius[:end], [cap.radius]])


def _smoothed(points: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Resample the line evenly and smooth it over `SMOOTHING` radii, keeping both ends."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.concatenate([[True], step > 1e-9])
    keep[-1] = True
    points, radius = points[keep], radius[keep]
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    typical = float(np.median(radius))
    count = int(np.clip(np.ceil(arc[-1] / (SPACING * typical)), 4, 2000)) + 1
    even = np.linspace(0, arc[-1], count)
    line = np.stack([np.interp(even, arc, points[:, k]) for k in range(3)], axis=1)
    local = np.interp(even, arc, radius)
    # Weights fade towards the ends, where the line is reflected through its end point so that the end stays.
    width = SMOOTHING * np.minimum(local, typical)
    ends = np.minimum(even, even[-1] - even)
    width = np.minimum(width, np.maximum(ends, 1e-9))
    reflected = np.vstack([2 * line[0] - line[:0:-1], line, 2 * line[-1] - line[-2::-1]])
    reflected_arc = np.concatenate([-even[:0:-1], even, 2 * even[-1] - even[-2::-1]])
    weight = np.exp(-0.5 * ((even[:, None] - reflected_arc) / width[:, None]) ** 2)
    smooth = (weight / weight.sum(axis=1, keepdims=True)) @ reflected
    smooth[0], smooth[-1] = line[0], line[-1]
    return smooth, local


class _Slicer:
    """Cross-sections of the surface near a point."""

    def __init__(self, surface: Surface):
        self.corners = surface.points[surface.triangles]
        self.centroids = self.corners.mean(axis=1)
        self.size = float(np.linalg.norm(self.corners - self.centroids[:, None], axis=2).max())
        self.kd = cKDTree(self.centroids)

    def area_radii(self, points: np.ndarray, inscribed: np.ndarray) -> np.ndarray:
        """Return the radius (n,) cm of a disc with the area of the cross-section, up to `REACH` inscribed radii.

        Near a bifurcation a section opens into the other vessel, or is an oval that is about to divide. The inscribed
        ball is far too narrow there: tubes of its radius have several times the lumen's resistance.
        """
        along = np.gradient(points, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        areas = [self._area(p, t, REACH * r) for p, t, r in zip(points, along, inscribed, strict=True)]
        return np.maximum(inscribed, np.sqrt(np.array(areas) / np.pi))

    def _area(self, point: np.ndarray, normal: np.ndarray, reach: float) -> float:
        near = np.array(self.kd.query_ball_point(point, reach + self.size), dtype=int)
        height = (self.corners[near] - point) @ normal
        crossing = (height.min(axis=1) < 0) & (height.max(axis=1) >= 0)
        corners, height = self.corners[near[crossing]], height[crossing]
        ends = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            through = (height[:, a] < 0) != (height[:, b] < 0)
            share = np.where(through, height[:, a] / np.where(through, height[:, a] - height[:, b], 1.0), np.nan)
            ends.append(corners[:, a] + share[:, None] * (corners[:, b] - corners[:, a]))
        three = np.stack(ends, axis=1)
        valid = np.isfinite(three[:, :, 0])
        two = three[valid].reshape(-1, 2, 3) - point
        # In every direction of the plane, the wall is at the nearest crossing of a segment.
        u = np.linalg.svd(normal[None])[2][1:]
        flat = two @ u.T
        return _star_area(flat, reach)


def _star_area(segments: np.ndarray, reach: float, rays: int = 72) -> float:
    """Return the area of a plane section, with boundary segments (m, 2, 2), visible from the origin up to `reach`."""
    angle = 2 * np.pi * (np.arange(rays) + 0.5) / rays
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    p, d = segments[:, 0], segments[:, 1] - segments[:, 0]
    cross = ray[:, None, 0] * d[None, :, 1] - ray[:, None, 1] * d[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (p[None, :, 0] * d[None, :, 1] - p[None, :, 1] * d[None, :, 0]) / cross
        along = (p[None, :, 0] * ray[:, None, 1] - p[None, :, 1] * ray[:, None, 0]) / cross
    hit = np.where((far > 0) & (along >= -1e-9) & (along <= 1 + 1e-9), far, reach).min(axis=1, initial=reach)
    return float(np.sum(hit**2) * np.pi / rays)
