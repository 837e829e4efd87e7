"""Where wall shear and distal pressure are evaluated: the wall around each stenosis, and a plane behind it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, throat
from coronaryuq.flow3d.mesh.description import Plane, Region
from coronaryuq.flow3d.mesh.generation.build import Built
from coronaryuq.flow3d.mesh.generation.folder import Mesh
from coronaryuq.flow3d.mesh.geometry.implicit import Path

ROUNDING = 1e-9
"""cm: arc lengths that differ by less are the same."""


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
        """Return whether a cross-section there, from 1 radius before to 2.5 behind, meets a bifurcation."""
        meets = np.flatnonzero(self.along.vessel[1:] != self.along.vessel[:-1])
        since = (offset - self.offset[meets]) / self.along.radii[meets]
        return bool(np.any((since > -1.0) & (since < 2.5)))


def course(tree: Tree, stenosis: Stenosis, built: Built) -> Course:
    """Return the path through a stenosis without the stretches beyond its caps."""
    place, _ = throat(tree, stenosis)
    for piece, surface in enumerate(built.implicit):
        for number, path in enumerate(surface.paths):
            own = np.flatnonzero(path.vessel == stenosis.vessel)
            if len(own):
                inside = _between_caps(path, built)
                path = Path(path.points[inside], path.radii[inside], path.vessel[inside], path.arc[inside], path.blend)
                s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path.points, axis=0), axis=1))]
                own = np.flatnonzero(path.vessel == stenosis.vessel)
                return Course(piece, number, s - np.interp(place, path.arc[own], s[own]), path)
    raise ValueError(f"stenosis {stenosis.name}: vessel {stenosis.vessel} is not in the mesh")


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
    head = str(path.vessel[0])
    return slice(1 if any(cap.inlet and cap.vessel == head for cap in built.caps) else 0, len(path.points) - 1)


def mark(
    tree: Tree, stenoses: Sequence[Stenosis], built: Built, upstream: float, downstream: float
) -> tuple[Mesh, dict[str, Region]]:
    """Return the mesh with `region` set, and the region of every stenosis.

    upstream, downstream: extent beyond the stenosis in local diameters. A region stays half a diameter away from caps,
    leaves out the walls of side branches, and ends half-way to another stenosis of the same artery.
    """
    mesh = built.mesh
    region = np.zeros(len(mesh.triangles), np.int64)
    wall = np.flatnonzero(mesh.wall_triangles())
    centres = mesh.points[mesh.triangles[wall]].mean(axis=1)
    size = 0.5 * np.linalg.norm(
        np.cross(
            mesh.points[mesh.triangles[:, 1]] - mesh.points[mesh.triangles[:, 0]],
            mesh.points[mesh.triangles[:, 2]] - mesh.points[mesh.triangles[:, 0]],
        ),
        axis=1,
    )
    marked = {}
    owners = [surface.nearest(centres) for surface in built.implicit]
    depth = np.column_stack([np.abs(surface.distance(centres)) for surface in built.implicit])
    piece_of = np.argmin(depth, axis=1)
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
        full = built.implicit[line.piece].paths[line.path]
        shift = len(full.points) - len(line.along.points) - 1
        path, segment, along = owners[line.piece]
        index = np.clip(segment - shift, 0, len(line.offset) - 2)
        offset = line.offset[index] + along * (line.offset[index + 1] - line.offset[index])
        inside = (piece_of == line.piece) & (path == line.path) & (offset >= low) & (offset <= high)
        region[wall[inside]] = number
        chosen = wall[inside]
        marked[stenosis.name] = Region(
            id=number,
            vessel=stenosis.vessel,
            throat=place,
            throat_radius=radius,
            start=low,
            end=high,
            triangles=int(inside.sum()),
            area=float(size[chosen].sum()),
        )
    return replace(mesh, region=region), marked


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
