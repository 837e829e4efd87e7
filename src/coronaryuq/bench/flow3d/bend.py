"""Flow through half a circle of a curved tube, in 3D, against developed flow in a torus."""

import numpy as np

from coronaryuq.bench.flow3d import torus
from coronaryuq.bench.flow3d.tubes import RADIUS, steady
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.elements import oriented
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.fem.wall_shear import WallShear
from coronaryuq.flow3d.verification.tube import tube

BEND, TURN = 1.0, np.pi
"""Radius of the tube's axis, cm, and the angle through which it turns."""
FIRST, LAST = 0.55 * TURN, 0.8 * TURN
"""Where flow is compared: it has developed since the inlet and does not feel the outlet yet."""
RINGS = 10
"""Rings of the reference's triangles; with 14 its flow differs by less than 1e-4 and wall shear by 2e-4 of the mean."""


def errors(rings: int, reynolds: np.ndarray, time: float = 0.5) -> dict[str, np.ndarray]:
    """Return errors (k,) of the pressure gradient and of wall shear.

    rings: cells over the radius. reynolds: (k,) of a straight tube with the same pressure gradient, by its diameter;
    at most LANES. `shear`: mean component along the tube, `around`: the one across it, both relative; `shear_rms`: of
    the component along the tube, relative to its mean.
    """
    space = _half_circle(rings)
    gradient = 16 * BLOOD_VISCOSITY**2 / BLOOD_DENSITY / (2 * RADIUS) ** 3 * 2 * reynolds
    exact = [torus.solve(RADIUS, BEND, one, RINGS, BLOOD_DENSITY, BLOOD_VISCOSITY) for one in gradient]
    stepper = steady(space, np.resize([flow.flow for flow in exact], LANES), time)
    wall, number = WallShear(space), len(reynolds)
    wall.sample(stepper, 1.0)
    place, stress = space.points[wall.nodes], wall.stress[..., :number]
    turned = np.arctan2(place[:, 1], place[:, 0])
    chosen = (turned > FIRST) & (turned < LAST)
    place, stress, turned, area = place[chosen], stress[chosen], turned[chosen], wall.area[chosen, 0]
    outward = np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)
    forward = np.stack([-np.sin(turned), np.cos(turned), 0 * turned], axis=1)
    out, up = (place * outward).sum(axis=1) - BEND, place[:, 2]
    # Along the wall towards the outside of the bend, above and below its plane.
    rising = (np.abs(up)[:, None] * outward - (np.sign(up) * out)[:, None] * [0.0, 0.0, 1.0]) / RADIUS
    angle, share = np.arctan2(np.abs(up), -out), area[:, None] / area.sum()
    along, around = (np.einsum("nck,nc->nk", stress, way) for way in (forward, rising))
    true_along = np.stack([np.interp(angle, flow.angle, flow.along) for flow in exact], axis=1)
    true_around = np.stack([np.interp(angle, flow.angle, flow.around) for flow in exact], axis=1)
    mean = (share * true_along).sum(axis=0)
    fall = (_pressure(space, stepper, FIRST) - _pressure(space, stepper, LAST))[:number] / (BEND * (LAST - FIRST))
    return {
        "gradient": fall / gradient - 1.0,
        "shear": (share * along).sum(axis=0) / mean - 1.0,
        "shear_rms": np.sqrt((share * (along - true_along) ** 2).sum(axis=0)) / mean,
        "around": (share * around).sum(axis=0) / (share * true_around).sum(axis=0) - 1.0,
    }


def _half_circle(rings: int) -> Discretisation:
    """Return the tube; its axis lies in the plane z = 0, around the origin."""
    points, tets, faces = tube(BEND * TURN, RADIUS, rings, int(BEND * TURN / RADIUS * rings * 0.7))
    turned, r = points[:, 2] / BEND, BEND + points[:, 1]
    points = np.stack([r * np.cos(turned), r * np.sin(turned), points[:, 0]], axis=1)
    caps = {name: faces[name] for name in ("inlet", "outlet")}
    return Discretisation(points, oriented(points, tets), caps, ["inlet"], 2e-3, BLOOD_DENSITY, BLOOD_VISCOSITY)


def _pressure(space: Discretisation, stepper, turned: float) -> np.ndarray:
    """Return the mean pressure (LANES,) of the cross-section at an angle."""
    centre, normal = (np.array([np.cos(turned), np.sin(turned), 0.0]), np.array([-np.sin(turned), np.cos(turned), 0.0]))
    nodes, weight = section_weights(space.points, space.elements.tets, BEND * centre, normal)[:2]
    return (weight[:, None] * stepper.pressure[nodes]).sum(axis=0)
