"""Straight tubes as verification cases: a discretised tube, and steps of it towards a steady flow."""

import numpy as np

from coronaryuq.flow3d.coupling import LinearCaps
from coronaryuq.flow3d.discretisation import Discretisation
from coronaryuq.flow3d.lanes import LANES
from coronaryuq.flow3d.step import Stepper
from coronaryuq.flow3d.tube import tube

DENSITY, VISCOSITY = 1.06, 0.04


def discretised(length, radius, rings, levels, dt, density=DENSITY, viscosity=VISCOSITY) -> Discretisation:
    points, tets, faces = tube(length, radius, rings, levels)
    caps = {name: faces[name] for name in ("inlet", "outlet")}
    return Discretisation(points, tets, caps, ["inlet"], dt, density, viscosity)


def prescribed_flow(flow, dt, ramp=0.0) -> LinearCaps:
    """Flow (LANES,) into the tube, nought pressure at its end; reached after `ramp` seconds."""

    def value(time):
        share = 1.0 if ramp == 0.0 else min(1.0, time / ramp)
        return np.stack([-share * flow, 0.0 * flow])

    return LinearCaps([0.0, 1.0], [1.0, 0.0], value, dt)


def steady(space: Discretisation, flow, time: float, ramp: float = 0.0) -> Stepper:
    """Run from rest to `time` (s) under prescribed flows."""
    stepper = Stepper(space)
    coupling = prescribed_flow(flow, space.dt, ramp)
    stepper.start(np.zeros((2, LANES)), np.zeros((2, LANES)))
    for _ in range(int(round(time / space.dt))):
        stepper.step(coupling)
    return stepper
