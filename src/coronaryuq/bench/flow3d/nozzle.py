"""The FDA's nozzle with a sudden expansion, throat Reynolds number 500, against laboratories' measurements.

Geometry and conditions: Stewart et al. 2012 (Cardiovasc Eng Technol 3:139); measurements: Hariharan et al. 2011
(J Biomech Eng 133:041002). A tube of 12 mm narrows in a cone to a throat of 4 mm diameter and 40 mm length, which opens
into a tube of 12 mm at z = 0.

`reference` solves the same problem by the axisymmetric solver. It separates the 3D solver's error from the
laboratories': where the exact solution of the stated problem is outside their range, that of any correct solver must be
outside as well.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.bench.flow3d import axisymmetric
from coronaryuq.bench.flow3d.tubes import driven
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import LENGTHS, PRESSURES
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.elements import boundary_faces, oriented
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.verification.tube import disc

DENSITY, VISCOSITY, FLOW = 1.056, 0.035, 5.20624
"""g/cm3, P, mL/s, as in the laboratories' files."""
TUBE, THROAT = 0.6, 0.2
"""Radii, cm."""
INLET, CONE, NECK, OUTLET = -9.6, -6.2685, -4.0, 16.0
"""Positions along z, cm: inlet, beginning and end of the cone, outlet."""
SPEED = FLOW / (np.pi * THROAT**2)
"""Mean velocity in the throat, cm/s."""
BREAKDOWN = 6.0
"""z (cm) up to which velocity is compared; downstream of it cells grow fourfold and the jet of the experiment breaks
up."""


def mesh(rings: int, outer: int, finest: float) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return points (n, 3) in cm, tetrahedra (m, 4) and the triangles of `inlet` and `outlet`.

    rings: cells over the throat's radius; outer: cells from there to the wall of the tube behind it, growing; finest:
    cell length (cm) at the expansion.
    """
    levels = _levels(finest)
    plane, triangles = disc(rings + outer)
    ring = np.rint(np.hypot(*plane.T) * (rings + outer)).astype(int)
    beyond = np.maximum(ring - rings, 0) / outer
    direction = plane / np.maximum(np.hypot(*plane.T), 1e-12)[:, None]
    n, layers, cells = len(plane), [], []
    for z in levels:
        radius = _facets(rings) * np.interp(z, [CONE, NECK], [TUBE, THROAT]) * np.minimum(ring, rings) / rings
        radius += (_facets(rings + outer) * TUBE - _facets(rings) * THROAT) * beyond**1.5
        layers.append(np.c_[direction * radius[:, None], np.full(n, z)])
    triangles = np.sort(triangles, axis=1)
    inner = triangles[(ring[triangles] <= rings).all(axis=1)]
    for k in range(len(levels) - 1):
        here = triangles if levels[k] >= 0 else inner
        a, b, c = (here + k * n).T
        d, e, f = (here + (k + 1) * n).T
        cells += [np.c_[a, b, c, f], np.c_[a, b, f, e], np.c_[a, e, f, d]]
    used, corners = np.unique(np.concatenate(cells), return_inverse=True)
    points = np.concatenate(layers)[used]
    tets = oriented(points, corners.reshape(-1, 4))
    faces = boundary_faces(tets)
    at = points[faces][:, :, 2]
    return points, tets, {name: faces[(at == z).all(axis=1)] for name, z in (("inlet", INLET), ("outlet", OUTLET))}


def _facets(rings: int) -> float:
    """Return the radius of a polygon's corners over that of the circle of its area."""
    corners = 6 * rings
    return float(np.sqrt(2 * np.pi / (corners * np.sin(2 * np.pi / corners))))


def _levels(finest: float) -> np.ndarray:
    """Return levels along z that include the cone's ends and the expansion.

    Finest at the expansion, four times as coarse along throat, cone and near jet, coarser far away.
    """

    def between(start, end, first, last):
        steps = max(2, int(np.ceil((end - start) / (0.5 * (first + last)))))
        growth = np.linspace(first, last, steps)
        inside = start + (end - start) * np.cumsum(growth)[:-1] / growth.sum()
        return [*inside, end]

    coarse = 4 * finest
    parts = [
        between(INLET, CONE, 2 * coarse, coarse / 2), between(CONE, NECK, coarse, coarse / 2),
        between(NECK, -1.0, coarse / 2, coarse), between(-1.0, 0.0, coarse, finest), between(0.0, 1.0, finest, coarse),
        between(1.0, BREAKDOWN, coarse, coarse), between(BREAKDOWN, OUTLET, coarse, 4 * coarse),
    ]  # fmt: skip
    return np.concatenate([[INLET], *parts])


@dataclass(frozen=True)
class Curves:
    """Axial velocity on the axis (cm/s) at z (cm), and pressure at the wall (dyn/cm2) at pressure_z."""

    z: np.ndarray
    axial: np.ndarray
    pressure_z: np.ndarray
    pressure: np.ndarray


@dataclass(frozen=True)
class NozzleFlow(Curves):
    """`change`: largest change of velocity up to BREAKDOWN over the last fifth of the time, relative to SPEED."""

    nodes: int
    change: float


def reference(rings: int = 10, outer: int = 8, finest: float = 0.05) -> Curves:
    """Compute the steady flow by quadratic elements in the half plane; parameters as for `mesh`."""
    z = _levels(finest)
    throat = np.outer(np.interp(z, [CONE, NECK], [TUBE, THROAT]), axisymmetric.graded(rings))
    beyond = THROAT + (TUBE - THROAT) * np.linspace(0, 1, outer + 1)[1:] ** 1.5
    grid = axisymmetric.Grid(z, np.c_[throat, np.tile(beyond, (len(z), 1))], np.where(z[:-1] < 0, rings, rings + outer))
    flow = axisymmetric.solve_on(grid, FLOW, DENSITY, VISCOSITY)
    return Curves(z, flow.axial, z, flow.wall_pressure)


def solve(rings: int = 8, outer: int = 6, finest: float = 0.05, time: float = 1.0, dt: float = 2.5e-3) -> NozzleFlow:
    """Compute the flow after `time` seconds, from rest behind an inlet with a developed profile."""
    points, tets, caps = mesh(rings, outer, finest)
    space = Discretisation(points, tets, caps, ["inlet"], dt, DENSITY, VISCOSITY, reference_speed=SPEED)
    flow = np.full(LANES, FLOW)
    stepper, driver = driven(space, lambda t: flow)
    stepper.start(np.zeros((2, LANES)), np.stack([-flow, flow]))  # its profile would take seconds to develop
    axis = np.flatnonzero(np.hypot(*space.points[:, :2].T) < 1e-9)
    axis = axis[np.argsort(space.points[axis, 2])]
    jet = space.points[axis, 2] <= BREAKDOWN
    steps = int(round(time / dt))
    for step in range(steps):
        if step == int(0.8 * steps):
            before = stepper.u[axis, 2, 0].copy()
        stepper.step(driver)
    axial = stepper.u[axis, 2, 0]
    wall = _wall(space)
    return NozzleFlow(
        space.points[axis, 2], axial, space.points[wall, 2], stepper.pressure[wall, 0],
        space.nodes, float(np.abs(axial - before)[jet].max() / SPEED),
    )  # fmt: skip


def _wall(space: Discretisation) -> np.ndarray:
    """Return one line of wall nodes along the nozzle, without the face of the step."""
    x, y, z = space.points.T
    line = np.flatnonzero(space.wall & (np.abs(y) < 1e-9) & (x > 0) & ((z != 0) | (x < 1.2 * THROAT)))
    return line[np.argsort(z[line])]


def measured(folder: str | Path) -> dict[str, dict[str, np.ndarray]]:
    """Read the laboratories' files *_500_*.txt.

    Laboratory → `axial` (k, 2: z in cm, cm/s), `pressure` (k, 2: z in cm, dyn/cm2) and `profile`, the axial velocity
    across the tube at z = −8.8 (k, 2: r in cm, cm/s).
    """
    wanted = {
        "axial": ("plot-z-distribution-axial-velocity", LENGTHS["m"]),
        "pressure": ("plot-wall-distribution-pressure", PRESSURES["Pa"]),
        "profile": ("plot-profile-axial-velocity-at-z -0.08800 0", LENGTHS["m"]),
    }
    found = {}
    for path in sorted(Path(folder).glob("*_500_*.txt")):
        lines = path.read_text(encoding="utf-8").splitlines()
        curves = {}
        for name, (heading, factor) in wanted.items():
            at = lines.index(heading)
            count = int(lines[at + 1].split()[0])
            rows = np.array([line.split()[:2] for line in lines[at + 2 : at + 2 + count]], float)
            curves[name] = rows * [LENGTHS["m"], factor]
        found[path.stem.rsplit("_", 1)[-1]] = curves
    if len(found) < 2:
        raise InputError(folder, "*_500_*.txt", len(found), "expected the files of two laboratories at least")
    return found


def carried(profile: np.ndarray) -> float:
    """Return the flow (mL/s) of a measured profile (k, 2: r, axial velocity), as the mean of its two halves."""
    halves = (profile[profile[:, 0] <= 0] * [-1, 1], profile[profile[:, 0] >= 0])
    sorted_halves = (half[np.argsort(half[:, 0])] for half in halves)
    return float(np.mean([2 * np.pi * np.trapezoid(r * u, r) for r, u in (half.T for half in sorted_halves)]))


@dataclass(frozen=True)
class Station:
    """`axial` velocity (cm/s) or `pressure` less that at the expansion (dyn/cm2) at z (cm): here, and by laboratory."""

    quantity: str
    z: float
    value: float
    measured: tuple[float, ...]

    def outside(self) -> float:
        """Return the distance of the value from the laboratories' range; 0 within."""
        return max(0.0, self.value - max(self.measured), min(self.measured) - self.value)

    def error(self) -> float:
        """Return the relative difference from the laboratories' mean."""
        return self.value / float(np.mean(self.measured)) - 1.0


def stations(flow: Curves, laboratories: dict[str, dict[str, np.ndarray]]) -> list[Station]:
    """Return the places where all laboratories measured: velocity up to BREAKDOWN, pressure everywhere."""
    found = []
    own = {"axial": (flow.z, flow.axial), "pressure": (flow.pressure_z, flow.pressure)}
    for quantity, (z, value) in own.items():
        curves = [{round(at, 6): y for at, y in curves[quantity]} for curves in laboratories.values()]
        places = sorted(set.intersection(*(set(curve) for curve in curves)))
        start = [curve[0.0] if quantity == "pressure" else 0.0 for curve in curves]
        offset = np.interp(0.0, z, value) if quantity == "pressure" else 0.0
        for place in places:
            if quantity == "pressure" or place <= BREAKDOWN:
                read = tuple(float(curve[place] - zero) for curve, zero in zip(curves, start, strict=True))
                found.append(Station(quantity, place, float(np.interp(place, z, value) - offset), read))
    return found
