"""SimVascular projects as they grow in ten years: several groups, time steps, names of all kinds, shadow files."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.simvascular import read_project
from coronaryuq.case.draft.source import recognise
from coronaryuq.core.errors import InputError
from support.sv_project import write_contours, write_path, write_vessel


@pytest.fixture
def project(tmp_path):
    """An aorta of radius 1 along z and an artery of radius 0.2 along x from its middle."""
    write_vessel(tmp_path, "aorta", (0, 0, 0), (0, 0, 6), 1.0)
    write_vessel(tmp_path, "LAD", (0, 0, 3), (5, 0, 3), 0.2)
    return tmp_path


def test_two_groups_of_one_path_are_refused_until_one_is_chosen(project):
    (project / "Segmentations" / "LAD.ctgr").unlink()
    write_contours(project, "LAD_final", (0, 0, 3), (5, 0, 3), 0.2, path="LAD")
    write_contours(project, "LAD_old", (0, 0, 3), (5, 0, 3), 0.4, path="LAD")
    with pytest.raises(
        InputError, match="path_name = 'LAD': several contour groups.*LAD_final, LAD_old.*anatomy.groups"
    ):
        read_project(project, 1.0)
    for name, radius in (("LAD_final", 0.2), ("LAD_old", 0.4)):
        tree, _ = read_project(project, 1.0, [name])
        assert np.isclose(np.median(tree["LAD"].radii), radius, rtol=0.02)
    with pytest.raises(InputError, match="anatomy.groups = 'LAD_new': no such contour group; there are"):
        read_project(project, 1.0, ["LAD_new"])


def test_of_two_groups_the_one_of_the_paths_own_name_is_taken_with_a_note(project):
    write_contours(project, "LAD_old", (0, 0, 3), (5, 0, 3), 0.4, path="LAD")
    tree, notes = read_project(project, 1.0)
    assert np.isclose(np.median(tree["LAD"].radii), 0.2, rtol=0.02)
    assert notes == ("path LAD: took the contour group of its own name, not LAD_old (anatomy.groups)",)
    assert np.isclose(np.median(read_project(project, 1.0, ["LAD_old"])[0]["LAD"].radii), 0.4, rtol=0.02)


def test_a_group_may_be_named_as_another_path(project):
    """The path that a group names counts, not the group's own name."""
    write_path(project, "LCx", (0, 0, 2), (-5, 0, 2))
    write_contours(project, "LAD", (0, 0, 2), (-5, 0, 2), 0.3, path="LCx")
    tree, notes = read_project(project, 1.0)
    assert np.isclose(np.median(tree["LCx"].radii), 0.3, rtol=0.02) and "LAD" not in tree
    assert notes == ("left out paths with fewer than two contours: LAD",)


def test_a_contour_group_without_its_path_is_told_where_the_tree_falls_apart(project):
    write_vessel(project, "D1", (3, 0, 3), (3, 4, 3), 0.15)
    (project / "Paths" / "LAD.pth").unlink()
    with pytest.raises(InputError, match="D1: path starts .*left out contour groups without a path in Paths: LAD"):
        read_project(project, 1.0)


def test_a_contour_group_without_its_path_is_noted(project):
    write_contours(project, "D1", (3, 0, 3), (3, 4, 3), 0.15)
    tree, notes = read_project(project, 1.0)
    assert "D1" not in tree and notes == ("left out contour groups without a path in Paths: D1",)


def test_a_bypass_graft_is_refused_by_name(project):
    write_vessel(project, "GRAFT", (0, 0, 5), (4, 0, 3), 0.2)
    with pytest.raises(InputError, match="GRAFT: ends inside LAD: bypass grafts and other loops cannot be modelled"):
        read_project(project, 1.0)


def test_a_path_that_runs_backwards_is_told(project):
    write_vessel(project, "D1", (3, 4, 3), (3, 0, 3), 0.15)
    with pytest.raises(InputError, match="D1: path starts .*it ends on another path: does it run backwards"):
        read_project(project, 1.0)


def test_an_empty_file_is_told(project):
    (project / "Segmentations" / "LAD.ctgr").write_text("\n")
    with pytest.raises(InputError, match="LAD.ctgr: is empty"):
        read_project(project, 1.0)


def test_capitals_of_folders_and_endings_do_not_matter(project):
    (project / "Paths").rename(project / "paths")
    (project / "paths" / "LAD.pth").rename(project / "paths" / "LAD.PTH")
    tree, notes = read_project(project, 1.0)
    assert {v.name for v in tree.leaves()} == {"aorta", "LAD"} and notes == ()
    assert recognise(project).kind == "simvascular"


def test_of_several_time_steps_the_first_is_taken_with_a_note(project):
    write_path(project, "LAD", (0, 0, 3), (5, 0, 3), times=3)
    write_contours(project, "LAD", (0, 0, 3), (5, 0, 3), 0.2, times=2)
    tree, notes = read_project(project, 1.0)
    assert np.allclose(tree["LAD"].radii, 0.2, rtol=0.02)
    assert notes == ("LAD.pth: took the first of 3 time steps", "LAD.ctgr: took the first of 2 time steps")


def test_an_empty_time_step_is_passed_over(project):
    path = project / "Segmentations" / "LAD.ctgr"
    path.write_text(path.read_text().replace("<timestep ", '<timestep id="9"/><timestep ', 1))
    assert "LAD" in read_project(project, 1.0)[0] and read_project(project, 1.0)[1] == ()


def test_a_file_without_contours_and_a_missing_folder_are_told(project):
    with pytest.raises(InputError, match="mine: no such folder"):
        read_project(project / "mine", 1.0)
    (project / "Segmentations" / "LAD.ctgr").write_text('<?xml version="1.0"?><model/>')
    with pytest.raises(InputError, match="LAD.ctgr: holds no path or contour group"):
        read_project(project, 1.0)


def test_two_contours_at_one_place_are_refused(project):
    write_contours(project, "LAD", (0, 0, 3), (5, 0, 3), 0.2, places=(0, 1, 2, 2, 4))
    with pytest.raises(InputError, match=r"LAD.ctgr: path_point = '2': has several contours; delete all but one"):
        read_project(project, 1.0)


def test_two_groups_in_one_file_are_refused(project):
    text = (project / "Segmentations" / "LAD.ctgr").read_text()
    (project / "Segmentations" / "LAD.ctgr").write_text(text + text[text.index("<contourgroup") :])
    with pytest.raises(InputError, match="LAD.ctgr: contourgroup = 2: several in one file"):
        read_project(project, 1.0)


@pytest.mark.parametrize("folder", ["Paths", "Segmentations"])
@pytest.mark.parametrize("shadow", ["._LAD", ".LAD"])
def test_hidden_files_are_left_alone(project, folder, shadow):
    suffix = {"Paths": ".pth", "Segmentations": ".ctgr"}[folder]
    (project / folder / f"{shadow}{suffix}").write_bytes(b"\0\5\26\7\0\2\0\0Mac OS X        ")
    assert set(read_project(project, 1.0)[0].vessels) == {"aorta_1", "aorta", "LAD"}


def test_parts_of_a_path_never_take_the_name_of_another(project):
    write_vessel(project, "LAD_1", (2, 0, 3), (2, 5, 3), 0.1)
    write_vessel(project, "aorta_1", (0, 0, 2), (-5, 0, 2), 0.2)
    tree, _ = read_project(project, 1.0)
    assert tree["LAD_1"].points[-1][1] == pytest.approx(5) and tree["aorta_1"].points[-1][0] == pytest.approx(-5)
    assert tree["LAD_1"].parent == "LAD_1_" and len({v.name for v in tree}) == len(tree)


@pytest.mark.parametrize(
    "name", ["001", "1e3", "NA", "null", "yes", "2024-01-01", "1", "0x10", "nan", "-", " LAD ", "L.AD"]
)
def test_paths_may_have_any_name(project, name):
    for folder, suffix in (("Paths", "pth"), ("Segmentations", "ctgr")):
        (project / folder / f"LAD.{suffix}").rename(project / folder / f"{name}.{suffix}")
    text = (project / "Segmentations" / f"{name}.ctgr").read_text()
    (project / "Segmentations" / f"{name}.ctgr").write_text(text.replace('path_name="LAD"', f'path_name="{name}"'))
    assert name.strip() in read_project(project, 1.0)[0]


def test_names_in_an_old_code_page_do_not_stop_the_reading(project):
    path = project / "Segmentations" / "LAD.ctgr"
    path.write_bytes(path.read_bytes().replace(b'path_id="1"', b'path_id="1" author="M\xfcller"'))
    assert "LAD" in read_project(project, 1.0)[0]


def test_a_group_whose_number_is_that_of_another_path_is_noted(project):
    """Name and number of the path contradicted each other without a word."""
    for name, number in (("aorta", 1), ("LAD", 2)):
        path = project / "Paths" / f"{name}.pth"
        path.write_text(path.read_text().replace('<path id="1">', f'<path id="{number}">'))
    tree, notes = read_project(project, 1.0)
    assert "LAD" in tree
    assert notes == ("LAD.ctgr: took path LAD of its path_name; its path_id 1 is that of aorta",)
    group = project / "Segmentations" / "LAD.ctgr"
    group.write_text(group.read_text().replace('path_id="1"', 'path_id="2"'))
    assert read_project(project, 1.0)[1] == ()
