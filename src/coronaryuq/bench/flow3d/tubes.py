"""Verification cases in straight tubes with exact solutions."""

from collections.abc import Callable

import numpy as np
from scipy.special import jv

from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.fem.time_step import Stepper
from coronaryuq.flow3d.fem.wall_shear import WallShear
from coronaryuq.flow3d.verification.prescribed_caps import LinearCaps
from coronaryuq.flow3d.verification.tube import tube

RADIUS = 0.15
"""cm."""


def narrowing(z: np.ndarray) -> np.ndarray:
    """Return the radius (cm) of a tube with a cosine stenosis of 60 % in diameter, 1 cm long, throat at z = 1 cm."""
    shape = np.where(np.abs(z - 1.0) < 0.5, 0.5 * (1 + np.cos(2 * np.pi * (z - 1.0))), 0.0)
    return RADIUS * (1 - 0.6 * shape)


def discretised(length, radius, rings, levels, dt, viscosity=BLOOD_VISCOSITY) -> Discretisation:
    """Return a tube of `length` cm with `rings` cells over its radius; its caps are `inlet` and `outlet`."""
    points, tets, faces = tube(length, radius, rings, levels)
    caps = {name: faces[name] for name in ("inlet", "outlet")}
    return Discretisation(points, tets, caps, ["inlet"], dt, BLOOD_DENSITY, viscosity)


def driven(space: Discretisation, flow: Callable[[float], np.ndarray], outlet: float = 0.0) -> tuple:
    """Return a stepper at rest, and caps that impose flow(t) (LANES,) into the tube and a pressure at its end."""
    stepper = Stepper(space)
    pressure = np.full(LANES, outlet)
    caps = LinearCaps(np.array([0, 1]), np.array([1, 0]), lambda t: np.stack([-flow(t), pressure]), space.dt)
    stepper.start(np.zeros((2, LANES)), np.zeros((2, LANES)))
    return stepper, caps


def steady(space: Discretisation, flow: np.ndarray, time: float, ramp: float = 0.02) -> Stepper:
    """Run from rest to `time` (s) with flows (LANES,) that rise over `ramp` (s)."""
    stepper, caps = driven(space, lambda t: flow * min(1.0, t / ramp))
    for _ in range(int(round(time / space.dt))):
        stepper.step(caps)
    return stepper


def poiseuille(rings: int, flow: np.ndarray, length: float = 0.9) -> dict[str, np.ndarray]:
    """Return errors of pressure drop and wall shear (mean, rms; middle third) in Poiseuille flow, (LANES,)."""
    space = discretised(length, RADIUS, rings, int(length / RADIUS * rings * 0.7), dt=2e-3)
    stepper = steady(space, flow, time=0.8)
    wall = WallShear(space)
    wall.sample(stepper, 1.0)
    height = space.points[wall.nodes, 2]
    middle = (height > length / 3) & (height < 2 * length / 3)
    exact = 4 * BLOOD_VISCOSITY * flow / (np.pi * RADIUS**3)
    stress = np.linalg.norm(wall.stress[middle], axis=1) / exact
    area = wall.area[middle] / wall.area[middle].sum()
    drop = 8 * BLOOD_VISCOSITY * length * flow / (np.pi * RADIUS**4)
    return {
        "drop": stepper.cap_pressure[0] / drop - 1.0,
        "shear": (area * stress).sum(axis=0) - 1.0,
        "shear_rms": np.sqrt((area * (stress - 1.0) ** 2).sum(axis=0)),
        "imbalance": np.abs(stepper.cap_flow.sum(axis=0)) / flow,
    }


def womersley(rings: int, steps: int, alpha: float, period: float = 0.4, cycles: int = 3) -> dict[str, np.ndarray]:
    """Return pressure gradient and wall shear over the exact ones, complex (LANES,), for flow ~ 1.3 + cos ωt.

    First harmonic. The mean keeps the flow from reversing, because flow into the outlet is damped.
    """
    length, omega = 0.6, 2 * np.pi / period
    viscosity = BLOOD_DENSITY * RADIUS**2 * omega / alpha**2
    space = discretised(length, RADIUS, rings, 3 * rings, period / steps, viscosity)
    wall = WallShear(space)
    flow = np.linspace(0.5, 1.5, LANES)
    stepper, caps = driven(space, lambda t: flow * (1.3 + np.cos(omega * t)))
    tets, normal = space.elements.tets, np.array([0, 0, 1])
    sections = [section_weights(space.points, tets, np.array([0, 0, z]), normal)[:2] for z in (0.2, 0.4)]
    height = space.points[wall.nodes, 2]
    middle = (height > 0.2) & (height < 0.4)
    area = wall.area[middle] / wall.area[middle].sum()
    gradient, shear = np.zeros(LANES, complex), np.zeros(LANES, complex)
    for step in range(1, cycles * steps + 1):
        stepper.step(caps)
        if step > (cycles - 1) * steps:
            low, high = ((weight[:, None] * stepper.pressure[nodes]).sum(axis=0) for nodes, weight in sections)
            wall.sample(stepper, 1.0)
            turn = 2.0 / steps * np.exp(-1j * omega * step * period / steps)
            gradient += turn * (low - high) / 0.2
            shear += turn * (area * wall.stress[middle, 2]).sum(axis=0)
    argument = 1j**1.5 * alpha
    share = 2 * jv(1, argument) / (argument * jv(0, argument))
    exact = flow * 1j * omega * BLOOD_DENSITY / (np.pi * RADIUS**2 * (1 - share))
    return {"gradient": gradient / exact, "shear": shear / (exact * RADIUS / 2 * share)}


def manufactured(rings: int, length: float = 0.6) -> float:
    """Return the relative L2 error of velocity against a steady swirling flow driven by a body force.

    u_z = 2U (1 − r²/R²), u_θ = A r (1 − r²/R²) sin²(πz/L), p = B r² sin(2πz/L): convection, pressure and viscosity all
    contribute, no-slip holds on the wall, the caps' pressure is uniform and their velocity normal to them.
    """
    space = discretised(length, RADIUS, rings, 4 * rings, dt=2e-3)
    x, y, z = space.points.T
    nu, mean, swirl, bulge = space.nu, 10.0, 100.0, 4000.0
    r2, k = x**2 + y**2, np.pi / length
    s, s1, s2 = np.sin(k * z) ** 2, k * np.sin(2 * k * z), 2 * k**2 * np.cos(2 * k * z)
    g = 1 - r2 / RADIUS**2
    axial, turn = 2 * mean * g, swirl * g * s
    exact = np.stack([-y * turn, x * turn, axial], axis=1)
    # In cylinder coordinates: −u_θ²/r and u_z ∂u_θ/∂z, ν (u_θ'' + u_θ'/r − u_θ/r² + ∂²u_θ/∂z²), and their like along z.
    around = axial * swirl * g * s1 - nu * swirl * (-8 / RADIUS**2 * s + g * s2)
    inward = -(turn**2) + 2 * bulge / space.density * np.sin(2 * k * z)
    along = 8 * nu * mean / RADIUS**2 + bulge / space.density * r2 * 2 * k * np.cos(2 * k * z)
    force = np.stack([x * inward - y * around, y * inward + x * around, along], axis=1)
    flow = np.full(LANES, mean * np.pi * RADIUS**2)
    stepper, caps = driven(space, lambda t: flow * min(1.0, t / 0.02))
    stepper.force = np.repeat(force[:, :, None], LANES, axis=2)
    for _ in range(int(round(0.8 / space.dt))):
        stepper.step(caps)
    error = stepper.u[:, :, 0] - exact
    return float(np.sqrt((space.mass * error**2).sum() / (space.mass * exact**2).sum()))
