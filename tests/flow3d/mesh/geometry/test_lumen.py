"""Distance to a triangulated lumen: against closed forms, with slivers and off its sharp edges."""

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.core.seeds import generator
from coronaryuq.flow3d.mesh.geometry import lumen
from coronaryuq.flow3d.mesh.geometry.lumen import Lumen, simplified


@pytest.fixture(scope="module")
def cylinder() -> Lumen:
    """Radius 1, height 4, along z, its flat ends fans of needles: long triangles that meet at sharp edges."""
    body = pv.Cylinder(radius=1.0, height=4.0, direction=(0, 0, 1), resolution=400).triangulate().clean()
    return Lumen(np.asarray(body.points, float), np.asarray(body.regular_faces, np.int64))


def exact(points):
    across, along = np.hypot(points[:, 0], points[:, 1]) - 1.0, np.abs(points[:, 2]) - 2.0
    outside = np.hypot(np.maximum(across, 0), np.maximum(along, 0))
    return outside + np.minimum(np.maximum(across, along), 0.0)


def test_the_signed_distance_is_exact_everywhere(cylinder):
    points = generator(1, "cylinder").uniform([-2, -2, -4], [2, 2, 4], (4000, 3))
    found = cylinder.distance(points)
    assert found == pytest.approx(exact(points), abs=1e-4)
    assert cylinder.distance(points[:0]).shape == (0,)


def test_the_sign_is_right_at_corners_of_sharp_rims(cylinder):
    corners = cylinder.points[np.hypot(cylinder.points[:, 0], cylinder.points[:, 1]) > 0.99]
    for way in ([0, 0, 1e-2], [0, 0, -1e-2]):
        moved = corners * [1.0 - 1e-3, 1.0 - 1e-3, 1.0] + way
        assert np.array_equal(cylinder.distance(moved) > 0, np.abs(moved[:, 2]) > 2.0)


def test_slivers_are_removed_and_the_volume_is_kept(cylinder):
    points, triangles = cylinder.points, cylinder.triangles
    split = len(points)
    first = triangles[0]
    points = np.vstack([points, 0.5 * (points[first[0]] + points[first[1]]) + 1e-7])
    slivers = [[first[0], split, first[2]], [split, first[1], first[2]]]
    other = next(k for k, t in enumerate(triangles) if k and {first[0], first[1]} <= set(t))
    third = next(i for i in triangles[other] if i not in first[:2])
    slivers += [[first[1], split, third], [split, first[0], third]]
    triangles = np.vstack([np.delete(triangles, [0, other], axis=0), slivers])
    clean = simplified(points, triangles, 1e-3)
    assert len(clean.points) < split + 1
    assert clean.distance(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.5]])) == pytest.approx([-1.0, 0.5], abs=1e-3)


def test_blocks_do_not_depend_on_how_many_are_processed_together(cylinder, monkeypatch):
    together = list(cylinder.blocks(0.15, 6))
    monkeypatch.setattr(lumen, "AT_ONCE", 7)
    apart = list(cylinder.blocks(0.15, 6))
    assert len(together) == len(apart) > 7
    for (corner, values), (other, found) in zip(together, apart, strict=True):
        assert np.array_equal(corner, other) and np.array_equal(values, found)
