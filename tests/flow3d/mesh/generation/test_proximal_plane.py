"""The plane before a stenosis lies where the stenosis begins, or upstream of the bifurcation that it begins at."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.flow3d.mesh.generation import regions
from coronaryuq.flow3d.mesh.generation.build import Built
from coronaryuq.flow3d.mesh.generation.folder import Mesh
from coronaryuq.flow3d.mesh.geometry import extent, paths
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit

NO_MESH = Mesh(np.zeros((0, 3)), np.zeros((0, 4), int), *[np.zeros(0, int)] * 3, {}, np.zeros(0, int))


def straight(name, start, end, radius, narrowed=None, parent=None):
    share = np.linspace(0.0, 1.0, 201)[:, None]
    points = (1.0 - share) * np.asarray(start, float) + share * np.asarray(end, float)
    vessel = Vessel(name, points, np.full(201, radius), parent, "LAD")
    inside = (vessel.arc > narrowed[0]) & (vessel.arc < narrowed[1]) if narrowed else np.zeros(201, bool)
    turn = 2 * np.pi * (vessel.arc - narrowed[0]) / (narrowed[1] - narrowed[0]) if narrowed else vessel.arc
    return Vessel(name, points, radius * (1 - 0.25 * (1 - np.cos(turn)) * inside), parent, "LAD")


def plane(vessel, start, end):
    """The plane before a stenosis of a trunk of 4 cm that forks into a main and a side branch."""
    narrowed = {vessel: (start, end)}
    tree = Tree(
        [
            straight("trunk", (0, 0, 0), (4, 0, 0), 0.15, narrowed.get("trunk")),
            straight("main", (4, 0, 0), (8, 0.5, 0), 0.13, narrowed.get("main"), "trunk"),
            straight("side", (4, 0, 0), (6, -2, 0), 0.09, narrowed.get("side"), "trunk"),
        ]
    )
    kept = extent.whole(tree)
    (group,) = extent.pieces(tree, kept)
    built = Built(NO_MESH, kept, paths.caps(tree, kept, group), [group], [Implicit(paths.paths(tree, kept, group))], [])
    stenosis = Stenosis("LAD", vessel, start, end)
    return regions.proximal_plane(tree, stenosis, [stenosis], built)


def test_it_lies_at_the_start_of_a_stenosis():
    found = plane("trunk", 1.5, 2.1)
    assert (found.vessel, found.arc) == ("trunk", pytest.approx(1.5, abs=0.03))
    assert found.point == pytest.approx([1.5, 0, 0], abs=1e-3) and found.normal == pytest.approx([1, 0, 0], abs=1e-6)
    assert found.distance_from_throat == pytest.approx(-0.3, abs=0.02)


@pytest.mark.parametrize("vessel", ["main", "side"])
def test_it_lies_in_the_parent_of_a_vessel_that_is_narrow_from_its_beginning(vessel):
    found = plane(vessel, 0.05, 0.8)
    assert found.vessel == "trunk" and found.point == pytest.approx([4.0 - 0.15, 0, 0], abs=0.03)
    assert found.distance_from_throat == pytest.approx(-0.15 - 0.425, abs=0.05)


def test_it_lies_in_the_branch_where_there_is_room_behind_the_fork():
    found = plane("side", 0.6, 1.2)
    assert (found.vessel, found.arc) == ("side", pytest.approx(0.6, abs=0.03))


def test_it_lies_inside_the_mesh_where_the_stenosis_begins_with_it():
    found = plane("trunk", 0.0, 1.0)
    assert 0.1 < found.point[0] <= 0.25 + 0.01 and found.distance_from_throat < 0.0
