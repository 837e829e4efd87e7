"""Where wall shear and pressure are evaluated: the wall around each stenosis, a plane before and one behind it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, throat
from coronaryuq.flow3d.mesh.description import Plane, Region
from coronaryuq.flow3d.mesh.generation.build import Built
from coronaryuq.flow3d.mesh.generation.folder import Mesh
from coronaryuq.flow3d.mesh.geometry.implicit import Path

ROUNDING = 1e-9
"""cm: arc lengths that differ by less are the same."""
AHEAD, BEHIND = 1.0, 2.5
"""Radii ahead of and behind a bifurcation within which a cross-section would cut it."""


@dataclass(frozen=True)
class Course:
    """The path through a stenosis: indices of piece and path, and distance from the throat (n,), cm, at every point."""

    piece: int
    path: int
    offset: np.ndarray
    along: Path

    def at(self, offset: float) -> tuple[np.ndarray, np.ndarray, float, str, float]:
        """Return point, unit tangent, radius (cm), vessel and arc length (cm) at a distance from the throat."""
        point = np.array([np.interp(offset, self.offset, self.along.points[:, k]) for k in range(3)])
        index = int(np.clip(np.searchsorted(self.offset, offset), 1, len(self.offset) - 1))
        low, high = max(0, index - 3), min(len(self.offset) - 1, index + 2)
        tangent = self.along.points[high] - self.along.points[low]
        vessel = str(self.along.vessel[int(np.argmin(np.abs(self.offset - offset)))])
        own = self.along.vessel == vessel
        return (
            point,
            tangent / np.linalg.norm(tangent),
            float(np.interp(offset, self.offset, self.along.radii)),
            vessel,
            float(np.interp(offset, self.offset[own], self.along.arc[own])),
        )

    def offset_of(self, vessel: str, arc: float) -> float:
        """Return the distance (cm) from the throat to an arc length (cm) of one of the vessels of the path."""
        own = self.along.vessel == vessel
        return float(np.interp(arc, self.along.arc[own], self.offset[own]))

    def at_bifurcation(self, offset: float) -> bool:
        """Return whether a cross-section there, from `AHEAD` radii before to `BEHIND` behind, meets a bifurcation."""
        meets = np.flatnonzero(self.along.vessel[1:] != self.along.vessel[:-1])
        since = (offset - self.offset[meets]) / self.along.radii[meets]
        return bool(np.any((since > -AHEAD) & (since < BEHIND)))


def course(tree: Tree, stenosis: Stenosis, built: Built) -> Course:
    """Return the path through a stenosis without the stretches beyond its caps."""
    return _course(built, stenosis.vessel, throat(tree, stenosis)[0])


def _course(built: Built, vessel: str, place: float) -> Course:
    """Return the path through a vessel, with distances from a place (cm) along it in the throat's stead."""
    for piece, surface in enumerate(built.implicit):
        for number, path in enumerate(surface.paths):
            own = np.flatnonzero(path.vessel == vessel)
            if len(own):
                inside = _between_caps(path, built)
                path = Path(path.points[inside], path.radii[inside], path.vessel[inside], path.arc[inside], path.blend)
                s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path.points, axis=0), axis=1))]
                own = np.flatnonzero(path.vessel == vessel)
                return Course(piece, number, s - np.interp(place, path.arc[own], s[own]), path)
    raise ValueError(f"vessel {vessel} is not in the mesh")


def neighbours(tree: Tree, stenosis: Stenosis, stenoses: Sequence[Stenosis], built: Built) -> tuple[float, float]:
    """Return where the stenosis before this one ends on its path, and where the next one starts, cm from its throat.

    Infinite where there is none.
    """
    line, before, after = course(tree, stenosis, built), -np.inf, np.inf
    for other in stenoses:
        beside = course(tree, other, built)
        if other is stenosis or (beside.piece, beside.path) != (line.piece, line.path):
            continue
        at = float(line.offset[0] - beside.offset[0])
        place, _ = throat(tree, other)
        if at < 0:
            before = max(before, at + other.end - place)
        else:
            after = min(after, at + other.start - place)
    return before, after


def _between_caps(path: Path, built: Built) -> slice:
    """Return the points except the one beyond the outlet and, if the path starts at an inlet, the one before it."""
    return slice(1 if _starts_at_cap(path, built) else 0, len(path.points) - 1)


def _starts_at_cap(path: Path, built: Built) -> bool:
    """Return whether a path starts at an inlet of the mesh rather than at a bifurcation."""
    return any(cap.inlet and cap.vessel == str(path.vessel[0]) for cap in built.caps)


def mark(
    tree: Tree, stenoses: Sequence[Stenosis], built: Built, upstream: float, downstream: float
) -> tuple[Mesh, dict[str, Region]]:
    """Return the mesh with `region` set, and the region of every stenosis.

    upstream, downstream: extent beyond the stenosis in local diameters. A region stays half a diameter away from caps,
    leaves out the walls of side branches, and ends half-way to another stenosis of the same artery.
    """
    walls, marked = _Walls(built), {}
    for number, stenosis in enumerate(stenoses, start=1):
        line = course(tree, stenosis, built)
        place, radius = throat(tree, stenosis)
        vessel = tree[stenosis.vessel]
        low = stenosis.start - place - 2.0 * upstream * float(vessel.radius_at(stenosis.start))
        high = stenosis.end - place + 2.0 * downstream * float(vessel.radius_at(stenosis.end))
        low = max(low, float(line.offset[0] + line.along.radii[0]))
        high = min(high, float(line.offset[-1] - line.along.radii[-1]))
        before, after = neighbours(tree, stenosis, stenoses, built)
        low = max(low, (before + stenosis.start - place) / 2.0)
        high = min(high, (after + stenosis.end - place) / 2.0)
        wanted = Region(id=number, vessel=stenosis.vessel, throat=place, throat_radius=radius, start=low, end=high)
        marked[stenosis.name] = walls.mark(wanted, line)
    return walls.mesh(), marked


def mark_again(regions: Mapping[str, Region], built: Built) -> tuple[Mesh, dict[str, Region]]:
    """Return a mesh with the regions of another one of the same vessels, between the same arc lengths."""
    walls = _Walls(built)
    marked = {name: walls.mark(old, _course(built, old.vessel, old.throat)) for name, old in regions.items()}
    return walls.mesh(), marked


class _Walls:
    """The wall of a mesh: its triangles by piece, path and place along it, and the region of each."""

    def __init__(self, built: Built):
        self._built, mesh = built, built.mesh
        self._region = np.zeros(len(mesh.triangles), np.int64)
        self._wall = np.flatnonzero(mesh.wall_triangles())
        centres = mesh.points[mesh.triangles[self._wall]].mean(axis=1)
        corner = mesh.points[mesh.triangles]
        across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        self._size = 0.5 * np.linalg.norm(across, axis=1)
        self._owners = [surface.nearest(centres) for surface in built.implicit]
        depth = np.column_stack([np.abs(surface.distance(centres)) for surface in built.implicit])
        self._piece = np.argmin(depth, axis=1)

    def mark(self, region: Region, line: Course) -> Region:
        """Mark the wall from the start to the end of a region, and return the region with its triangles' number."""
        full = self._built.implicit[line.piece].paths[line.path]
        shift = len(full.points) - len(line.along.points) - 1
        path, segment, along = self._owners[line.piece]
        index = np.clip(segment - shift, 0, len(line.offset) - 2)
        offset = line.offset[index] + along * (line.offset[index + 1] - line.offset[index])
        inside = (self._piece == line.piece) & (path == line.path) & (offset >= region.start) & (offset <= region.end)
        chosen = self._wall[inside]
        self._region[chosen] = region.id
        return region.model_copy(update={"triangles": len(chosen), "area": float(self._size[chosen].sum())})

    def mesh(self) -> Mesh:
        """Return the mesh with its regions."""
        return replace(self._built.mesh, region=self._region)


def plane(tree: Tree, stenosis: Stenosis, stenoses: Sequence[Stenosis], built: Built, diameters: float) -> Plane:
    """Return the plane of distal pressure: where the case asks for, or `diameters` local diameters beyond the stenosis.

    Where the case asks for: exactly there, as 0D does, unless the stenosis reaches to less than one radius before a
    bifurcation. Elsewhere, at most one radius before the end of the mesh, before the next stenosis of the artery, and
    moved along the artery where it would cut a bifurcation.
    """
    line = course(tree, stenosis, built)
    place, _ = throat(tree, stenosis)
    vessel, read = tree[stenosis.vessel], stenosis.read
    if read is not None and read.arc <= vessel.length - float(vessel.radii[-1]) + ROUNDING:
        return _plane_at(line, line.offset_of(vessel.name, read.arc))
    radius = float(vessel.radius_at(stenosis.end))
    end = stenosis.end - place
    last = float(line.offset[-1] - line.along.radii[-1])
    _, after = neighbours(tree, stenosis, stenoses, built)
    last = min(last, max(after, end))
    wanted = min(end if read is not None else end + 2.0 * diameters * radius, last)
    places = np.linspace(min(end + radius, last), last, 200)
    return _clear_plane(line, places, wanted)


def proximal_plane(tree: Tree, stenosis: Stenosis, stenoses: Sequence[Stenosis], built: Built) -> Plane:
    """Return the plane of proximal pressure, where the stenosis begins.

    At least one radius behind the beginning of the mesh, behind the stenosis before it in the artery, and moved
    upstream where it would cut a bifurcation, into the parent vessel if need be.
    """
    line = course(tree, stenosis, built)
    place, _ = throat(tree, stenosis)
    start, begin = stenosis.start - place, float(line.offset[0])
    parent = None if _starts_at_cap(line.along, built) else tree[str(line.along.vessel[0])].parent
    room = (1.0 if parent is None else BEHIND) * float(line.along.radii[0])
    if parent is not None and start < begin + room:
        above = _course(built, parent, tree[parent].length)
        places = np.linspace(min(float(above.offset[0] + above.along.radii[0]), 0.0), 0.0, 200)
        found = _clear_plane(above, places, 0.0)
        return found.model_copy(update={"distance_from_throat": begin + found.distance_from_throat})
    before, _ = neighbours(tree, stenosis, stenoses, built)
    # A stenosis at the very beginning of the mesh has its plane inside, half-way to its throat at most.
    first = max(min(begin + room, 0.5 * begin), min(before, start))
    wanted = max(start, first)
    return _clear_plane(line, np.append(np.linspace(first, wanted, 200), wanted), wanted)


def _clear_plane(line: Course, places: np.ndarray, wanted: float) -> Plane:
    """Return the plane nearest to the wanted place among those, cm from the throat, that cut no bifurcation."""
    clear = places[[not line.at_bifurcation(offset) for offset in places]]
    return _plane_at(line, wanted if len(clear) == 0 else float(clear[np.argmin(np.abs(clear - wanted))]))


def _plane_at(line: Course, offset: float) -> Plane:
    point, normal, radius, vessel, arc = line.at(offset)
    return Plane(
        point=tuple(point.tolist()),
        normal=tuple(normal.tolist()),
        radius=radius,
        vessel=vessel,
        arc=arc,
        distance_from_throat=offset,
    )
