"""Steady flow through a circular tube: pressure drop and wall shear stress against Hagen and Poiseuille."""

import numpy as np
import pytest
from channels import VISCOSITY, discretised, steady

from coronaryuq.flow3d.lanes import LANES
from coronaryuq.flow3d.wall_shear import WallShear

RADIUS, LENGTH = 0.15, 0.9
FLOW = np.linspace(0.5, 2.0, LANES)


def errors(rings):
    """Error of the pressure drop, and mean and rms error of wall shear in the tube's middle third, each (LANES,)."""
    space = discretised(LENGTH, RADIUS, rings, int(LENGTH / RADIUS * rings * 0.7), dt=2e-3)
    stepper = steady(space, FLOW, time=0.8)
    drop = 8 * VISCOSITY * LENGTH * FLOW / (np.pi * RADIUS**4)
    wall = WallShear(space)
    wall.sample(stepper, 1.0)
    height = space.points[wall.nodes, 2]
    middle = (height > LENGTH / 3) & (height < 2 * LENGTH / 3)
    stress = np.linalg.norm(wall.stress[middle], axis=1) / (4 * VISCOSITY * FLOW / (np.pi * RADIUS**3))
    area = wall.area[middle, None] / wall.area[middle].sum()
    mean = (area * stress).sum(axis=0)
    rms = np.sqrt((area * (stress - 1.0) ** 2).sum(axis=0))
    return stepper.cap_pressure[0] / drop - 1.0, mean - 1.0, rms


@pytest.fixture(scope="module")
def meshes():
    return {rings: errors(rings) for rings in (3, 6)}


def test_pressure_drop_converges_with_second_order(meshes):
    coarse, fine = np.abs(meshes[3][0]), np.abs(meshes[6][0])
    assert (fine < 0.02).all()
    assert (np.log2(coarse / fine) > 1.7).all()


def test_wall_shear_converges_with_second_order(meshes):
    assert (np.abs(meshes[6][1]) < 0.02).all()
    assert (meshes[6][2] < 0.03).all()
    assert (np.log2(np.abs(meshes[3][1] / meshes[6][1])) > 1.7).all()


def test_wall_shear_points_with_the_flow(meshes):
    space = discretised(0.4, RADIUS, 3, 6, dt=2e-3)
    stepper = steady(space, FLOW, time=0.1)
    wall = WallShear(space)
    wall.sample(stepper, 1.0)
    assert (wall.stress[:, 2] > 0).all()
    across = np.einsum("wcs,wc->ws", wall.stress, wall.normal)
    assert np.abs(across).max() < 1e-10 * np.abs(wall.stress).max()
