"""A closed surface cut flat behind its caps: volume, names, and walls that run through a cap."""

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.flow3d.mesh.generation import quality
from coronaryuq.flow3d.mesh.geometry.clip_caps import INSET, trimmed
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.paths import Cap
from coronaryuq.flow3d.mesh.geometry.surface import enclosed_volume

LENGTH, RADIUS = 4.0, 1.0


def tube(dips: bool = False):
    """A tube along z and its caps; where it dips, its wall passes through the lower cap and out again."""
    body = pv.Cylinder(radius=RADIUS, height=LENGTH, direction=(0, 0, 1), resolution=60).triangulate().subdivide(3)
    body = body.clean()
    points, triangles = np.array(body.points, float), np.asarray(body.regular_faces, np.int64)
    caps, faces = [], []
    for name, side in (("inlet", -1.0), ("outlet", 1.0)):
        normal = np.array([0.0, 0.0, side])
        caps.append(Cap(name, "v", 0.0, side < 0, 0.5 * LENGTH * normal, normal, RADIUS))
        faces.append(np.flatnonzero((side * points[triangles][:, :, 2] > 0.5 * LENGTH - 1e-6).all(axis=1)))
    ring = np.abs(points[:, 2] + 0.375 * LENGTH) < 1e-6
    dipped = ring & (np.hypot(points[:, 0], points[:, 1]) > 0.9) & (points[:, 0] > 0.9)
    points[dipped] = np.where(dips, points[dipped] * [0.95, 0.95, 1.34], points[dipped])
    return points, triangles, faces, caps


@pytest.mark.parametrize(("dips", "exact"), [(False, 1e-3), (True, 0.02)])
def test_ends_are_cut_flat_at_the_inset_and_keep_their_references(dips, exact):
    points, triangles, faces, caps = tube(dips)
    points, triangles, refs = trimmed(points, triangles, faces, caps, 1e-3)
    ngon = 0.5 * 60 * np.sin(2 * np.pi / 60) * RADIUS**2
    depth = INSET * RADIUS
    assert enclosed_volume(points, triangles) == pytest.approx(ngon * (LENGTH - 2 * depth), rel=exact)
    for number, cap in enumerate(caps, start=2):
        own = triangles[refs == number]
        assert (points[own] - cap.centre) @ cap.normal == pytest.approx(-depth, abs=1e-9)
        assert quality.areas(points, own).sum(axis=0) == pytest.approx(ngon * cap.normal, abs=3.0 * exact)
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_an_open_surface_is_rejected():
    points, triangles, faces, caps = tube()
    with pytest.raises(MeshError, match="closed and manifold"):
        trimmed(points, triangles[:-1], faces, caps, 1e-3)
