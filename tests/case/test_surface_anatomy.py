"""From a closed surface back to the tree that it was made of; and a real aortic root."""

import re
import shutil

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.centrelines import signed_distance
from coronaryuq.case.anatomy.simvascular import read_project
from coronaryuq.case.anatomy.stenosis_detection import detected_stenoses
from coronaryuq.case.anatomy.surface import read_surface, surface_of
from coronaryuq.case.anatomy.tree import Stenosis, Tree, area_ratio, throat
from coronaryuq.case.assembly import assemble
from coronaryuq.case.settings import Settings
from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator
from coronaryuq.synthetic.anatomy import narrowed
from support.aortic_root import write_aortic_root_case
from support.case_files import check_case, straight, write_case
from support.surface_trees import random_tree, recovered, resistance, topology
from support.tubes import tube_surface


@pytest.mark.parametrize(
    ("seed", "outlets"),
    [(1, 4), pytest.param(2, 9, marks=pytest.mark.long), pytest.param(3, 14, marks=pytest.mark.long)],
)
def test_the_tree_extracted_from_a_surface_is_that_it_was_made_from(seed, outlets):
    tree = random_tree(seed, outlets)
    surface = surface_of(*tube_surface(tree, 0.045))
    assert len(surface.caps) == outlets + 2
    for vessel in tree.leaves():
        cap = min(surface.caps, key=lambda cap: float(np.linalg.norm(cap.centre - vessel.points[-1])))
        assert np.linalg.norm(cap.centre - vessel.points[-1]) < 0.02
        assert cap.radius == pytest.approx(vessel.radii[-1], rel=0.06)
        assert cap.normal @ vessel.tangent_at(vessel.length) > 0.99
    found = recovered(tree, surface)
    assert topology(found) == topology(tree)
    for vessel in tree.leaves():
        if vessel.branch == "aorta":
            continue
        true = sum(v.length for v in tree.path(vessel.name))
        assert sum(v.length for v in found.path(vessel.name)) == pytest.approx(true, rel=0.05)
        # Through all bifurcations, from where the first vessel has left the aorta.
        path = tree.path(vessel.name)[1:]
        assert resistance(found.path(vessel.name)[1:], 0.8) == pytest.approx(resistance(path, 0.8), rel=0.02)
        line = found[vessel.name]
        inner = (line.arc > 3 * vessel.radii[0]) & (line.arc < line.length - 2 * vessel.radii[-1])
        for point, radius in zip(line.points[inner], line.radii[inner], strict=True):
            _, arc, distance = tree.nearest(point, [vessel.name])
            assert distance < 0.2 * vessel.radii[-1]
            assert radius == pytest.approx(float(vessel.radius_at(arc)), rel=0.08)


@pytest.mark.slow
def test_a_stenosis_survives_the_way_through_a_surface(small_tree):
    stenosis = Stenosis("RCA", "rca1", 3.0, 4.2)
    made = Tree(
        straight(v.name, v.points[0], v.points[-1] - v.points[0], v.length, (0.6, 0.6), v.parent)
        if v.branch == "aorta"
        else v
        for v in small_tree
    )
    made = made.with_vessels({"rca1": narrowed(made["rca1"], stenosis, 0.5)})
    found = recovered(made, surface_of(*tube_surface(made, 0.045)))
    labelled = Tree(
        type(v)(v.name, v.points, v.radii, v.parent, "RCA" if v.name == "rca1" else "aorta") for v in found
    )  # fmt: skip
    (place,) = detected_stenoses(labelled, 0.7, 0.0, {})
    at = labelled["rca1"].position_at(throat(labelled, place)[0])
    # A tenth of a centimetre off the throat the radius is 7 % more: a surface of 0.045 cm triangles cannot tell.
    assert np.linalg.norm(at - made["rca1"].position_at(3.6)) < 0.12
    assert throat(labelled, place)[1] == pytest.approx(throat(made, stenosis)[1], rel=0.08)
    assert area_ratio(labelled, place) == pytest.approx(0.25, abs=0.05)


def test_no_narrowing_is_found_in_vessels_that_only_taper_or_divide():
    tree = random_tree(5, 6)
    relabelled = Tree(
        type(v)(v.name, v.points, v.radii, v.parent, "aorta" if v.branch == "aorta" else "LAD") for v in tree
    )  # fmt: skip
    assert detected_stenoses(relabelled, 0.95, 0.0, {}) == []


@pytest.mark.slow
def test_open_ends_are_closed_and_a_three_point_hole_is_only_noted(small_tree, tmp_path):
    points, triangles = tube_surface(random_tree(1, 4), 0.05)
    whole = surface_of(points, triangles)
    caps = np.concatenate([cap.faces for cap in whole.caps])
    wall = np.setdiff1d(np.arange(len(whole.triangles)), caps)
    middle = whole.points[whole.triangles[wall]].mean(axis=1)[:, 2]
    wall = np.delete(wall, np.argmin(np.abs(middle - 0.6)))
    mesh = pv.PolyData(whole.points, np.column_stack([np.full(len(wall), 3), whole.triangles[wall]]).ravel())
    mesh.save(tmp_path / "open.vtp")
    again = read_surface(tmp_path / "open.vtp")
    assert len(again.caps) == len(whole.caps) == 6
    assert sum("spurious hole of 3 points" in note for note in again.notes) == 1
    assert sum("closed an open end" in note for note in again.notes) == 6
    for a, b in zip(whole.caps, again.caps, strict=True):
        assert a.radius == pytest.approx(b.radius, rel=1e-3)


@pytest.mark.slow
def test_a_faulty_surface_is_mended_and_the_mending_noted(tmp_path):
    points, triangles = tube_surface(random_tree(1, 4), 0.06)
    whole = surface_of(points, triangles)
    random = generator(4, "faults")
    turned = np.flatnonzero(random.random(len(triangles)) < 0.1)
    faulty = triangles.copy()
    faulty[turned] = faulty[turned][:, ::-1]
    fin = [*triangles[500, :2], len(points)]
    faulty = np.vstack([faulty, triangles[[100]], [fin]])
    points = np.vstack([points, points[triangles[500]].mean(axis=0) + [0.02, 0.01, 0.0]])
    # As in a file of single triangles, rounded: no two share a point.
    corners = points[faulty].reshape(-1, 3)
    corners += 1e-7 * random.normal(size=corners.shape)
    pv.PolyData.from_regular_faces(corners, np.arange(len(corners)).reshape(-1, 3)).save(tmp_path / "faulty.vtp")
    again = read_surface(tmp_path / "faulty.vtp")
    assert any("removed 2 triangles that are duplicates or not part of" in note for note in again.notes)
    assert any(f"flipped {len(turned)} triangles" in note for note in again.notes)
    assert again.polydata().volume == pytest.approx(whole.polydata().volume, rel=1e-6)
    assert len(again.caps) == len(whole.caps)
    for a, b in zip(whole.caps, again.caps, strict=True):
        assert np.allclose(a.centre, b.centre, atol=1e-4) and a.radius == pytest.approx(b.radius, rel=1e-4)


def test_a_ball_is_no_lumen(tmp_path):
    pv.Sphere(radius=1.0).save(tmp_path / "ball.stl")
    with pytest.raises(InputError, match="ball.stl: caps = 0: flat ends found; expected at least an inlet"):
        read_surface(tmp_path / "ball.stl")


@pytest.mark.slow
def test_a_case_with_a_surface_names_the_caps_that_it_lacks_points_for(tmp_path):
    tree = random_tree(1, 4)
    points, triangles = tube_surface(tree, 0.05)
    path = write_case(tmp_path, tree, anatomy="{surface: lumen.stl, unit: mm}", stenoses="[]")
    mesh = pv.PolyData(points * 10, np.column_stack([np.full(len(triangles), 3), triangles]).ravel())
    mesh.save(tmp_path / "lumen.stl")
    rows = [(v.name, *(v.points[-1] * 10), v.branch) for v in tree.leaves() if v.branch != "aorta"]
    table = "name,x,y,z,perfuses,branch\n" + "".join(f"{n},{x},{y},{z},LV,{b}\n" for n, x, y, z, b in rows)
    (tmp_path / "outlets.csv").write_text(table)
    case = assemble(path, Settings())
    assert [outlet.vessel for outlet in case.summary.outlets] == [row[0] for row in rows]
    assert case.summary.systemic == ["BC_RCR1"]
    (tmp_path / "outlets.csv").write_text(table.replace(f",{rows[0][1]},", ",500,"))
    assert "the surface has no unassigned cap there; unassigned caps: (" in check_case(path)[0][0]
    (tmp_path / "outlets.csv").write_text("".join(line for line in table.splitlines(True) if rows[0][0] not in line))
    assert "no row of the table matches this coronary-sized cap; add one" in check_case(path)[0][0]


@pytest.mark.long
def test_the_real_aortic_root_becomes_a_case(shared, tmp_path):
    path = write_aortic_root_case(shared, tmp_path)
    case = assemble(path, Settings())
    assert len(case.summary.outlets) == 7 and len(case.summary.systemic) == 1
    assert [s.name for s in case.summary.stenoses] == ["LAD", "LCx", "RCA"]
    assert 80 < case.wall.volume < 150
    surface = read_surface(tmp_path / "lumen.stl")
    for vessel in case.tree:
        inner = vessel.points[1:-1]
        assert (signed_distance(surface, inner) < 0).all()
        if vessel.branch != "aorta":
            assert vessel.radii.min() > 0.02 and vessel.radii.max() < 0.4
    # Arteries on the ventricle lie near its outside, none runs through its wall.
    centres = np.asarray(case.wall.mesh.cell_centers().points)
    nearest = pv.PolyData(centres)
    for name in ("lca1", "rca1"):
        ends = case.tree[name].points
        off = np.array([np.linalg.norm(centres - p, axis=1).min() for p in ends])
        assert np.median(off) < 1.5
    assert nearest.n_points == case.wall.mesh.n_cells


def test_a_simvascular_project_becomes_a_tree(shared):
    tree, notes = read_project(shared / "data" / "coro0d-p1", 0.1)
    assert notes == ()
    assert {v.name for v in tree.leaves()} == {"LAD", "LCx", "c1", "c2", "c3", "c4", "c5"}
    assert tree.root.name == "LAD_1"
    left = sum(v.length for v in tree.path("LAD"))
    assert 8 < left < 16
    assert 0.2 < tree.root.radii[0] < 0.3
    assert all(0.07 < v.radii[-1] < 0.13 for v in tree.leaves())
    # Straight pieces between its contours have a corner of 59 degrees.
    along = np.diff(tree["LAD"].points[2:], axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert ((along[1:] * along[:-1]).sum(axis=1) > np.cos(np.radians(35.0))).all()


@pytest.fixture
def project(shared, tmp_path):
    """A copy of the project to spoil."""
    for name in ("Paths", "Segmentations"):
        shutil.copytree(shared / "data" / "coro0d-p1" / name, tmp_path / name, copy_function=shutil.copyfile)
        (tmp_path / name).chmod(0o755)
    return tmp_path


def test_contours_belong_to_the_path_that_they_name_and_lie_in_its_order(project):
    tree, _ = read_project(project, 0.1)
    group = project / "Segmentations" / "LAD.ctgr"
    text = group.read_text()
    contours = re.findall("<contour .*?</contour>", text, flags=re.DOTALL)
    text = text.replace(contours[2], "@").replace(contours[5], contours[2]).replace("@", contours[5])
    (project / "Segmentations" / "left anterior.ctgr").write_text(text)
    group.unlink()
    again, notes = read_project(project, 0.1)
    assert notes == ()
    for one, other in zip(tree, again, strict=True):
        assert one.name == other.name and np.array_equal(one.points, other.points)


def test_a_path_without_contours_is_left_out_and_named(project):
    (project / "Segmentations" / "c3.ctgr").unlink()
    tree, notes = read_project(project, 0.1)
    assert notes == ("left out paths with fewer than two contours: c3",) and "c3" not in tree
    (project / "Segmentations" / "LCx.ctgr").unlink()
    with pytest.raises(
        InputError, match="radii from .*, the nearest.*; left out paths with fewer than two contours: LCx, c3"
    ):
        read_project(project, 0.1)


def test_a_contour_that_encloses_nothing_is_reported(project):
    group = project / "Segmentations" / "LAD.ctgr"
    text = group.read_text()
    contour = re.findall("<contour .*?</contour>", text, flags=re.DOTALL)[4]
    group.write_text(text.replace(contour, re.sub('([xyz])="[^"]*"', r'\1="0"', contour)))
    with pytest.raises(InputError, match="LAD.ctgr: contour 4: has no area; redraw it"):
        read_project(project, 0.1)


def test_a_folder_that_is_no_project_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"expected Paths/\*.pth and Segmentations/\*.ctgr"):
        read_project(tmp_path, 0.1)


def test_contours_without_an_aorta_become_a_case_with_one(shared, small_tree, tmp_path):
    project = shared / "data" / "coro0d-p1"
    path = write_case(
        tmp_path, small_tree, anatomy=f"{{simvascular: {project.resolve()}, unit: mm}}", stenoses="auto",
        perfusion=None, territory_flows="{file: flows.csv, unit: mL/min}",
    )  # fmt: skip
    branch = {"LCx": "LCx", "c4": "LCx", "c5": "LCx"}
    names = [v.name for v in read_project(project, 0.1)[0].leaves()]
    rows = "".join(f"{name},{name},LV,{branch.get(name, 'LAD')}\n" for name in names)
    (tmp_path / "outlets.csv").write_text("name,vessel,perfuses,branch\n" + rows)
    (tmp_path / "flows.csv").write_text("name,flow\n" + "".join(f"{name},30\n" for name in names))
    case = assemble(path, Settings(narrowing=0.99))
    assert any("has no aorta" in note for note in case.summary.notes)
    assert case.summary.systemic == ["BC_RCR1"] and len(case.summary.outlets) == 7
    first = next(v for v in case.tree if case.tree.ostial(v))
    assert case.tree.emergence(first.name) == pytest.approx(1.3, rel=0.02)
    assert np.linalg.norm(first.points[1] - read_project(project, 0.1)[0].root.points[0]) < 1e-9
