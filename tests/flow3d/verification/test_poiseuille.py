"""Steady flow through a circular tube: pressure drop and wall shear stress against Hagen and Poiseuille."""

import numpy as np
import pytest

from coronaryuq.bench.flow3d import tubes
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.fem.wall_shear import WallShear

FLOW = np.linspace(0.5, 2.0, LANES)


@pytest.fixture(scope="module")
def meshes():
    return {rings: tubes.poiseuille(rings, FLOW) for rings in (3, 5)}


def order(meshes, name):
    return np.log(np.abs(meshes[3][name] / meshes[5][name])) / np.log(5 / 3)


def test_pressure_drop_converges_with_second_order(meshes):
    assert (np.abs(meshes[5]["drop"]) < 0.03).all()
    assert (order(meshes, "drop") > 1.7).all()


def test_wall_shear_converges_with_second_order(meshes):
    assert (np.abs(meshes[5]["shear"]) < 0.03).all()
    assert (meshes[5]["shear_rms"] < 0.04).all()
    assert (order(meshes, "shear") > 1.7).all()


def test_flows_balance(meshes):
    assert (meshes[5]["imbalance"] < 1e-6).all()


def test_wall_shear_points_with_the_flow():
    space = tubes.discretised(0.4, tubes.RADIUS, 3, 6, dt=2e-3)
    wall = WallShear(space)
    wall.sample(tubes.steady(space, FLOW, time=0.1), 1.0)
    assert (wall.stress[:, 2] > 0).all()
    across = (wall.stress * wall.normal).sum(axis=1)
    assert np.abs(across).max() < 1e-10 * np.abs(wall.stress).max()
