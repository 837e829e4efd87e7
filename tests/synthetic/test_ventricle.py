"""The bundled ventricle has the stated volumes, a mesh without gaps, and coordinates that can be inverted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.synthetic.ventricle import Ventricle

VENTRICLE = Ventricle()


def volumes(mesh):
    return np.asarray(mesh.compute_cell_sizes(length=False, area=False, volume=True)["Volume"])


def test_wall_and_cavity_are_those_of_an_adult():
    assert 100 < VENTRICLE.wall_volume < 130
    assert 70 < VENTRICLE.inner.volume < 120


def test_the_volume_of_an_ellipsoid_agrees_with_quadrature():
    a, b, h = VENTRICLE.outer.length, VENTRICLE.outer.radius, VENTRICLE.outer.cut
    z = np.linspace(-a, h, 200_001)
    assert VENTRICLE.outer.volume == pytest.approx(np.trapezoid(np.pi * b**2 * (1 - z**2 / a**2), z), rel=1e-8)


def test_the_volume_of_the_mesh_converges_at_second_order():
    error = [1 - volumes(VENTRICLE.mesh(cells)).sum() / VENTRICLE.wall_volume for cells in (4_000, 32_000)]
    assert 0 < error[1] < 0.005
    # Eight times the cells halve the spacing: the error of chords falls by four.
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.35)


@pytest.mark.parametrize("cells", [5_000, 20_000, 50_000])
def test_the_mesh_has_about_the_requested_number_of_similar_cells_and_no_gaps(cells):
    mesh = VENTRICLE.mesh(cells)
    volume = volumes(mesh)
    assert 0.7 < mesh.n_cells / cells < 1.45
    assert (volume > 0).all() and volume.max() / volume.min() < 6
    surface = mesh.extract_surface(algorithm="dataset_surface")
    assert surface.is_manifold and surface.n_open_edges == 0
    assert abs(surface.volume) == pytest.approx(volume.sum(), rel=1e-9)


def test_tetrahedra_have_positive_volume():
    mesh = VENTRICLE.mesh(3000)
    a, b, c, d = np.asarray(mesh.points)[next(iter(mesh.cells_dict.values()))].transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) > 0).all()


@settings(max_examples=60, deadline=None)
@given(phi=st.floats(0, 6.28), s=st.floats(0.01, 0.97), depth=st.floats(-0.3, 1.0))
def test_coordinates_invert_points(phi, s, depth):
    point = VENTRICLE.point(np.array([phi]), np.array([s]), np.array([depth]))
    coordinates = VENTRICLE.coordinates(point)
    assert [float(values[0]) for values in coordinates] == pytest.approx([phi, s, depth], abs=1e-9)


def test_the_right_ventricle_bulges_over_the_septum_only():
    phi = np.radians([0.0, 90.0, 122.0, 182.0, 243.0, 300.0])
    bulge = np.linalg.norm(VENTRICLE.epicardium(phi, 0.1) - VENTRICLE.outer.point(phi, 0.1), axis=1)
    assert bulge[[0, 1, 2, 4, 5]] == pytest.approx(0.0, abs=1e-6)
    assert bulge[3] > 2.0
