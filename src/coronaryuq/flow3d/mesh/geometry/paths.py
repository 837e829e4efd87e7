"""Paths, caps and element sizes of one piece of the mesh, from the kept intervals of vessels."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial import cKDTree

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.flow3d.mesh.geometry.extent import Kept, continuation, daughters, starts_at_bifurcation
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit, Path
from coronaryuq.flow3d.mesh.settings import Settings

SPACING = 0.25
"""Spacing of centreline points in radii."""

BLEND = 0.4
"""Width of the blend at a bifurcation, in radii of the daughter."""

CORE = 1.5
"""Radius of a jet's core, in radii of its throat."""


@dataclass(frozen=True)
class Cap:
    """Where a vessel is cut: arc length, centre (3,) and radius in cm, outward unit normal (3,).

    inlet: whether it is the vessel's proximal end.
    """

    name: str
    vessel: str
    arc: float
    inlet: bool
    centre: np.ndarray
    normal: np.ndarray
    radius: float


def caps(tree: Tree, kept: Kept, piece: Sequence[str]) -> list[Cap]:
    """Return the caps of a piece: inlets first, both in the order of the tree."""
    inlets = [_cap(tree[n], kept[n][0], inlet=True) for n in piece if not starts_at_bifurcation(tree, kept, n)]
    outlets = [_cap(tree[n], kept[n][1], inlet=False) for n in piece if not daughters(tree, kept, n)]
    return inlets + outlets


def _cap(vessel: Vessel, arc: float, inlet: bool) -> Cap:
    tangent = vessel.tangent_at(arc)
    return Cap(
        name=f"{'inlet' if inlet else 'outlet'}_{vessel.name}",
        vessel=vessel.name,
        arc=float(arc),
        inlet=inlet,
        centre=vessel.position_at(arc),
        normal=-tangent if inlet else tangent,
        radius=float(vessel.radius_at(arc)),
    )


def paths(tree: Tree, kept: Kept, piece: Sequence[str]) -> list[Path]:
    """Return the paths of a piece, parents before daughters.

    Each follows the artery through its bifurcations and extends beyond its caps.
    """
    carried: set[str] = set()
    result = []
    for name in piece:
        if name in carried:
            continue
        chain = [name]
        while onward := daughters(tree, kept, chain[-1]):
            chain.append(continuation(tree, chain[-1], onward))
        carried.update(chain)
        result.append(_path(tree, kept, chain))
    return result


def _path(tree: Tree, kept: Kept, chain: Sequence[str]) -> Path:
    parts: list[tuple[np.ndarray, ...]] = []
    for name in chain:
        s, p, r = smooth(tree[name], *kept[name])
        skip = 1 if parts else 0
        parts.append((p[skip:], r[skip:], np.full(len(s) - skip, name), s[skip:]))
    p, r, owner, arc = map(np.concatenate, zip(*parts, strict=True))
    blend = BLEND * float(r[0])
    if not starts_at_bifurcation(tree, kept, chain[0]):
        p = np.vstack([p[0] - r[0] * tree[chain[0]].tangent_at(kept[chain[0]][0]), p])
        r, owner, arc = np.r_[r[0], r], np.r_[owner[:1], owner], np.r_[arc[0], arc]
    p = np.vstack([p, p[-1] + r[-1] * tree[chain[-1]].tangent_at(kept[chain[-1]][1])])
    r, owner, arc = np.r_[r, r[-1]], np.r_[owner, owner[-1:]], np.r_[arc, arc[-1]]
    return Path(p, r, owner, arc, blend)


def smooth(vessel: Vessel, start: float, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return arc lengths (m,), points (m, 3) and radii (m,) between two arc lengths, by a monotone cubic."""
    spacing = SPACING * float(np.min(vessel.between(start, end).radii))
    arc = np.linspace(start, end, max(2, int(np.ceil((end - start) / spacing)) + 1))
    curve = PchipInterpolator(vessel.arc, np.column_stack([vessel.points, vessel.radii]), axis=0)(arc)
    return arc, curve[:, :3], curve[:, 3]


class Size:
    """Element size: radius / (R/h) of the vessel that owns a point.

    R/h is `resolution`; within a stenosis it rises in proportion to the radius lost, to `throat_resolution` at the
    throat. From there to the downstream end of the stenosis region it is at least `jet_resolution` (at most the
    throat's), because elements as large as the jet mix it away and spoil its wall shear; in the jet's core, `CORE`
    throat radii around the axis, it is `core_resolution` of the throat's radius. These are widths: from the throat to
    the end of the region elements are `axial_stretch` times as long, upstream of the throat less in proportion to the
    radius lost.

    factor: on all sizes. stretched: whether any element is longer than wide.
    """

    def __init__(self, implicit: Implicit, stenoses: Sequence[Stenosis], settings: Settings):
        self.implicit, self.factor = implicit, 1.0
        self._sizes, self._stretches, self._cores = [], [], []
        for path in implicit.paths:
            ratio, stretch = np.full(len(path.radii), settings.resolution), np.ones(len(path.radii))
            for stenosis in stenoses:
                within, lost = narrowed(path, stenosis)
                if not len(within):
                    continue
                ratio[within] += (settings.throat_resolution - settings.resolution) * lost
                stretch[within] = np.maximum(stretch[within], 1.0 + (settings.axial_stretch - 1.0) * lost)
                throat = within[np.argmax(lost)]
                jet = slice(throat, None)
                length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path.points[jet], axis=0), axis=1))]
                last = within[-1] - throat
                reach = length[last] + 2.0 * settings.region_downstream_diameters * path.radii[jet][last]
                least = min(settings.jet_resolution, settings.throat_resolution)
                ratio[jet] = np.where(length <= reach, np.maximum(ratio[jet], least), ratio[jet])
                stretch[jet] = np.where(length <= reach, settings.axial_stretch, stretch[jet])
                if settings.core_resolution:
                    line = path.points[jet][length <= reach]
                    self._cores.append((line, float(path.radii[throat]), settings.core_resolution))
            self._sizes.append(path.radii / ratio)
            self._stretches.append(stretch)
        self.stretched = any(bool((stretch > 1.0).any()) for stretch in self._stretches)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return the wanted edge length (m,) across the vessel at points (m, 3), cm."""
        path, segment, along = self.implicit.nearest(points)
        size = np.empty(len(points))
        for index, values in enumerate(self._sizes):
            own = path == index
            size[own] = values[segment[own]] * (1.0 - along[own]) + values[segment[own] + 1] * along[own]
        for line, radius, resolution in self._cores:
            off, _ = cKDTree(line).query(points)
            size = np.minimum(size, radius / resolution + 0.5 * np.maximum(off - CORE * radius, 0.0))
        return self.factor * size

    def varied(self, factor: float, stretched: bool) -> "Size":
        """Return a copy with all sizes times `factor`, and without stretch unless `stretched`."""
        varied = copy(self)
        varied.factor, varied.stretched = self.factor * factor, self.stretched and stretched
        return varied

    def metric(self, points: np.ndarray) -> np.ndarray:
        """Return the metric (m, 6), cm^-2: xx, xy, xz, yy, yz, zz of the tensor that gives wanted edges length 1."""
        path, segment, along = self.implicit.nearest(points)
        stretch, tangent = np.empty(len(points)), np.empty((len(points), 3))
        for index, values in enumerate(self._stretches):
            own = np.flatnonzero(path == index)
            first, t = segment[own], along[own]
            stretch[own] = values[first] * (1.0 - t) + values[first + 1] * t
            line = self.implicit.paths[index].points
            tangent[own] = line[first + 1] - line[first]
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        across = self(points) ** -2.0
        less = across * (1.0 - stretch**-2.0)
        i, j = np.triu_indices(3)
        return across[:, None] * (i == j) - less[:, None] * tangent[:, i] * tangent[:, j]


def narrowed(path: Path, stenosis: Stenosis) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of a path inside a stenosis (k,), and their radius loss relative to the throat's (k,)."""
    inside = (path.vessel == stenosis.vessel) & (path.arc >= stenosis.start) & (path.arc <= stenosis.end)
    within = np.flatnonzero(inside)
    if not len(within):
        return within, np.empty(0)
    healthy = np.interp(path.arc[within], [stenosis.start, stenosis.end], path.radii[within][[0, -1]])
    lost = np.clip(1.0 - path.radii[within] / healthy, 0.0, None)
    return within, lost / lost.max() if lost.max() > 0.0 else np.ones_like(lost)
