"""Measures of tetrahedra against closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coronaryuq.core.seeds import generator
from coronaryuq.flow3d.mesh.generation import quality

REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])[[0, 2, 1, 3]]
ONE = np.array([[0, 1, 2, 3]])


def test_the_regular_tetrahedron_has_its_known_shape():
    turned = 0.3 * Rotation.from_rotvec([0.3, 1.0, -0.5]).apply(REGULAR) + 2.0
    assert quality.volumes(turned, ONE) == pytest.approx(8.0 / 3.0 * 0.3**3)
    assert quality.radius_ratio(turned, ONE) == pytest.approx(1.0)
    assert quality.dihedral_angles(turned, ONE)[0] == pytest.approx([np.degrees(np.arccos(1 / 3))] * 6)
    assert quality.altitudes(turned, ONE) == pytest.approx(0.3 * 4.0 / np.sqrt(3.0))


def test_radius_ratio_of_the_corner_of_a_cube():
    """Inscribed radius (3 - √3)/6, circumscribed √3/2."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    assert quality.radius_ratio(corner, ONE) == pytest.approx(3.0 * (3.0 - np.sqrt(3.0)) / 6.0 / (np.sqrt(3.0) / 2.0))
    assert sorted(quality.dihedral_angles(corner, ONE)[0]) == pytest.approx([54.7356] * 3 + [90.0] * 3, abs=1e-3)


def test_random_tetrahedra_have_the_circumradius_of_their_sphere():
    rng = generator(3, "spheres")
    points = rng.normal(size=(4, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    tets = ONE if quality.volumes(points, ONE)[0] > 0 else ONE[:, [0, 1, 3, 2]]
    area = np.linalg.norm(quality.areas(points, quality.boundary(tets)[0]), axis=1).sum()
    expected = 3.0 * 3.0 * quality.volumes(points, tets) / area
    assert quality.radius_ratio(points, tets) == pytest.approx(expected)
