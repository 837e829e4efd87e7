"""The bundled heart lies as a heart does: apex left, forwards and down, and it is not its own mirror image."""

import numpy as np

from coronaryuq.synthetic.anatomy import patient_anatomy


def test_apex_points_left_forwards_and_down():
    wall = patient_anatomy().wall(3000)
    points = np.asarray(wall.points)
    base = points[np.argsort(points @ [0.6, -0.53, -0.6])[: len(points) // 20]].mean(axis=0)
    apex = points[np.argmax(points @ [0.6, -0.53, -0.6])]
    assert (np.sign(apex - base) == [1, -1, -1]).all()


def test_seen_from_the_apex_with_the_anterior_wall_up_the_right_ventricle_is_on_the_left():
    anatomy = patient_anatomy()
    ends = {outlet.label: anatomy.tree[outlet.vessel].points[-1] for outlet in anatomy.outlets}
    points = np.asarray(anatomy.wall(3000).points)
    long_axis = anatomy.body(np.array([0.0, 0.0, -1.0]))
    up = ends["LAD"] - ends["PDA"]
    right = np.cross(-long_axis, up)
    assert (ends["RV"] - points.mean(axis=0)) @ right < 0
    assert (ends["OM3"] - points.mean(axis=0)) @ right > 0


def test_tetrahedra_of_the_wall_have_positive_volume():
    wall = patient_anatomy().wall(3000)
    corners = np.asarray(wall.points)[next(iter(wall.cells_dict.values()))]
    a, b, c, d = corners.transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) > 0).all()
