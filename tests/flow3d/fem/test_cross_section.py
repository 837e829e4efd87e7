"""Means over cross-sections: exact for linear fields, one vessel at a time."""

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.verification.tube import tube


@pytest.fixture(scope="module")
def mesh():
    points, tets, _ = tube(1.0, 0.2, 4, 10)
    return points, tets


@pytest.mark.parametrize("normal", [(0, 0, 1.0), (0.3, -0.2, 1.0)])
def test_mean_of_a_linear_field_is_its_value_at_the_centroid(mesh, normal):
    points, tets = mesh
    centre = np.array([0.0, 0.0, 0.47])
    nodes, weight, area = section_weights(points, tets, centre, np.array(normal))
    assert weight.sum() == pytest.approx(1.0)
    assert weight @ (points[nodes] @ [1.0, 2.0, 3.0]) == pytest.approx(3 * 0.47, abs=1e-3)
    circle = np.pi * 0.2**2 / (np.array(normal)[2] / np.linalg.norm(normal))
    assert area == pytest.approx(circle, rel=0.02)


def test_only_the_nearest_of_two_vessels_counts(mesh):
    points, tets = mesh
    both = np.concatenate([points, points + [1.0, 0, 0]])
    nodes, _, area = section_weights(
        both, np.concatenate([tets, tets + len(points)]), np.array([1.0, 0, 0.5]), np.array([0, 0, 1.0])
    )
    assert (nodes >= len(points)).all()
    assert area == pytest.approx(np.pi * 0.2**2, rel=0.02)


def test_a_plane_outside_the_mesh_is_rejected(mesh):
    with pytest.raises(InputError, match="planes.LAD"):
        section_weights(*mesh, np.array([0, 0, 3.0]), np.array([0, 0, 1.0]), "LAD")
