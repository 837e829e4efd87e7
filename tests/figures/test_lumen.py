"""A curved artery is straightened: its walls are parallel, and places along it keep their distances."""

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.figures.lumen import FINE, straightened
from coronaryuq.flow3d.mesh.description import Plane

BEND, RADIUS = 2.0, 0.2


@pytest.fixture(scope="module")
def bent():
    """A quarter of a circle, narrowed in its middle, filled with blood whose pressure falls along it."""
    angle = np.linspace(0, np.pi / 2, 200)
    points = np.column_stack([BEND * np.sin(angle), np.zeros(200), BEND * (1 - np.cos(angle))])
    radii = RADIUS * (1 - 0.4 * np.exp(-(((angle - np.pi / 4) / 0.12) ** 2)))
    vessel = Vessel("bend", points, radii, None, "LAD")
    box = pv.ImageData(dimensions=(121, 31, 121), spacing=(0.02,) * 3, origin=(-0.2, -0.3, -0.2))
    at = box.points
    turned = np.arctan2(at[:, 0], BEND - at[:, 2])
    away = np.hypot(np.hypot(at[:, 0], BEND - at[:, 2]) - BEND, at[:, 1])
    local = np.interp(turned, angle, radii)
    box["inside"] = local - away
    box["mmHg"] = 100 - 10 * turned
    box["speed"] = np.where(turned > 0, 1.0, 0.0)
    inside = box.clip_scalar(scalars="inside", value=0.0, invert=False).clip(normal="-x", origin=(0, 0, 0))
    return inside, Tree([vessel]), Stenosis("LAD", "bend", 1.2, 1.9)


def test_the_view_shows_the_lumens_own_width_and_distances(bent):
    inside, tree, stenosis = bent
    vessel = tree["bend"]
    read = 0.9
    plane = Plane(point=(0, 0, 0), normal=(1, 0, 0), radius=0.2, vessel="bend", arc=2.4, distance_from_throat=read)
    view = straightened(inside, tree, stenosis, {"LAD": plane})
    throat = vessel.arc[np.argmin(vessel.radii)]
    assert view.lesion == pytest.approx((1.2 - throat, 1.9 - throat))
    assert view.read == read and view.along[0] < -1.0 and view.along[-1] > read
    width = np.isfinite(view.values["mmHg"]).sum(axis=0) * FINE
    within = (view.along > -1.2) & (view.along < 1.2)
    assert width[within] == pytest.approx(2 * vessel.radius_at(throat + view.along[within]), abs=0.05)
    middle = view.values["mmHg"][len(view.across) // 2]
    assert middle[within] == pytest.approx(100 - 10 * (throat + view.along[within]) / BEND, abs=0.1)


def test_a_lesion_without_a_plane_is_shown_too(bent):
    view = straightened(*bent, {})
    assert view.read is None and np.isfinite(view.values["speed"]).any()
