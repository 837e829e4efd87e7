"""The centreline tree: what is asked of it has one right answer, and what it was given comes back from its file."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, area_ratio, read_tree, throat, write_tree
from coronaryuq.core.errors import InputError
from coronaryuq.synthetic.anatomy import narrowed
from support.case_files import straight


def test_a_tree_comes_back_from_its_file_to_the_bit(small_tree, tmp_path):
    write_tree(tmp_path / "tree.vtp", small_tree)
    back = read_tree(tmp_path / "tree.vtp")
    assert [(v.name, v.parent, v.branch) for v in back] == [(v.name, v.parent, v.branch) for v in small_tree]
    for vessel in small_tree:
        assert np.array_equal(back[vessel.name].points, vessel.points)
        assert np.array_equal(back[vessel.name].radii, vessel.radii)


def test_polylines_without_names_are_joined_by_their_ends(small_tree, tmp_path):
    import pyvista as pv

    write_tree(tmp_path / "tree.vtp", small_tree)
    mesh = pv.read(tmp_path / "tree.vtp")
    mesh.cell_data.clear()
    mesh.points *= 10
    mesh["Radius"] *= 10
    mesh.save(tmp_path / "plain.vtp")
    back = read_tree(tmp_path / "plain.vtp", scale=0.1)
    assert [v.name for v in back] == [f"branch{k}" for k in range(6)]
    assert [v.parent for v in back] == [None, "branch0", "branch1", "branch1", "branch0", "branch0"]
    assert back.root.length == pytest.approx(2.0, rel=1e-12)


def test_arc_length_position_and_tangent_of_a_quarter_circle():
    angle = np.linspace(0, np.pi / 2, 2001)
    arc = Vessel("v", np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), np.full(2001, 0.1))
    assert arc.length == pytest.approx(np.pi / 2, rel=1e-6)
    assert arc.position_at(np.pi / 4) == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0], abs=1e-6)
    assert arc.tangent_at(np.pi / 4) == pytest.approx([-np.sqrt(0.5), np.sqrt(0.5), 0], abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(start=st.floats(0.0, 1.9), share=st.floats(0.05, 1.0))
def test_a_part_of_a_vessel_has_the_length_and_radii_that_were_asked_for(start, share):
    vessel = straight("v", (0, 0, 0), (1, 2, 2), 2.0, (0.2, 0.1))
    end = start + share * (2.0 - start)
    part = vessel.between(start, end)
    assert part.length == pytest.approx(end - start, abs=1e-9)
    assert part.radii[[0, -1]] == pytest.approx([0.2 - 0.05 * start, 0.2 - 0.05 * end], abs=1e-9)


def test_an_ostial_artery_emerges_where_it_leaves_the_aortic_wall(small_tree):
    assert small_tree.emergence("branch1") == pytest.approx(1.2, abs=2e-3)
    assert small_tree.emergence("lca1") == 0.0
    assert [v.name for v in small_tree if small_tree.ostial(v)] == ["branch1", "rca1"]


def test_paths_subtrees_and_leaves(small_tree):
    assert [v.name for v in small_tree.path("lca2")] == ["aorta", "branch1", "lca2"]
    assert [v.name for v in small_tree.subtree("branch1")] == ["branch1", "lca1", "lca2"]
    assert [v.name for v in small_tree.leaves()] == ["lca1", "lca2", "rca1", "aorta_outlet"]


def test_the_nearest_place_of_a_tree(small_tree):
    name, arc, distance = small_tree.nearest([-3.0, 0.3, 2.0])
    assert (name, arc, distance) == ("rca1", pytest.approx(3.0), pytest.approx(0.3))


@pytest.mark.parametrize("reduction", [0.3, 0.5, 0.7])
def test_a_cosine_narrowing_has_the_area_ratio_that_its_diameter_says(small_tree, reduction):
    stenosis = Stenosis("RCA", "rca1", 3.0, 4.0)
    tree = small_tree.with_vessels({"rca1": narrowed(small_tree["rca1"], stenosis, reduction)})
    assert area_ratio(tree, stenosis) == pytest.approx((1 - reduction) ** 2, rel=1e-3)
    assert throat(tree, stenosis)[0] == pytest.approx(3.5, abs=0.03)
    assert tree["rca1"].radius_at([2.9, 4.1]) == pytest.approx(small_tree["rca1"].radius_at([2.9, 4.1]), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radii": np.array([0.1, -0.1])}, "radii positive"),
        ({"points": np.zeros((2, 3))}, "repeats a point"),
        ({"parent": "nobody"}, "does not come before it"),
        ({"parent": None}, "a second root"),
        ({"branch": "aorte"}, "is none of"),
        ({"points": np.array([[0, 0, 5.0], [1, 0, 5.0]])}, "cm from the end of"),
    ],
)
def test_vessels_that_are_no_tree_are_refused_by_name(small_tree, change, message):
    sound = {
        "points": np.array([[0, 0, 2.0], [0, 2, 2.0]]),
        "radii": np.full(2, 0.1),
        "parent": "aorta",
        "branch": "RCA",
    }
    with pytest.raises(ValueError, match=f"vessel bad: .*{message}"):
        Tree([*small_tree, Vessel("bad", **(sound | change))])


def test_a_file_without_radii_is_refused_in_one_line(small_tree, tmp_path):
    import pyvista as pv

    write_tree(tmp_path / "tree.vtp", small_tree)
    mesh = pv.read(tmp_path / "tree.vtp")
    del mesh.point_data["Radius"]
    mesh.save(tmp_path / "bare.vtp")
    with pytest.raises(InputError, match=r"bare.vtp: Radius: point data missing"):
        read_tree(tmp_path / "bare.vtp")
    with pytest.raises(InputError, match="no such file"):
        read_tree(tmp_path / "absent.vtp")
