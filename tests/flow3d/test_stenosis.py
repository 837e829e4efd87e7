"""A smooth stenosis of 60 % in diameter against an axisymmetric solution by another method."""

import numpy as np
import pytest
from channels import DENSITY, VISCOSITY, discretised, steady

from coronaryuq.bench.axisymmetric import solve
from coronaryuq.flow3d.lanes import LANES
from coronaryuq.flow3d.section import section_weights

RADIUS, LENGTH = 0.15, 2.4


def radius(z):
    shape = np.where(np.abs(z - 1.0) < 0.5, 0.5 * (1 + np.cos(2 * np.pi * (z - 1.0))), 0.0)
    return RADIUS * (1 - 0.6 * shape)


def pressure_between(nodes_pressure, space, low, high):
    means = []
    for z in (low, high):
        nodes, weight, _ = section_weights(space.points, space.tets, np.array([0, 0, z]), np.array([0, 0, 1.0]))
        means.append((weight[:, None] * nodes_pressure[nodes]).sum(axis=0))
    return means[0] - means[1]


def test_reference_is_exact_for_poiseuille_flow():
    flow = solve(lambda z: RADIUS + 0 * z, np.linspace(0, 1, 11), 5, 1.0, DENSITY, VISCOSITY)
    assert flow.pressure[0] - flow.pressure[-1] == pytest.approx(8 * VISCOSITY / (np.pi * RADIUS**4), rel=1e-8)
    assert flow.wall_shear[5] == pytest.approx(4 * VISCOSITY / (np.pi * RADIUS**3), rel=1e-8)


def test_pressure_drop_converges_to_the_reference():
    flow = 0.4
    reference = solve(radius, np.linspace(0, LENGTH, 73), 10, flow, DENSITY, VISCOSITY)
    exact = np.interp(0.4, reference.z, reference.pressure) - np.interp(1.8, reference.z, reference.pressure)
    errors = []
    for rings in (3, 5):
        space = discretised(LENGTH, radius, rings, 18 * rings, dt=2e-3)
        stepper = steady(space, np.full(LANES, flow), time=0.3, ramp=0.02)
        errors.append(abs(pressure_between(stepper.pressure, space, 0.4, 1.8)[0] / exact - 1))
    assert errors[1] < 0.04
    assert errors[0] / errors[1] > 1.5
