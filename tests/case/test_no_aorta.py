"""Coronary trees without an aorta, one or two, become a case with an added aorta and a note on it."""

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.synthetic_aorta import with_aorta
from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.draft.draft import draft_anatomy
from coronaryuq.case.draft.source import recognise
from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core.io.atomic import read_json
from support.case_files import check_case, straight


def tree_at(x: float, name: str, branch: str, along: float = 1.0) -> Tree:
    return Tree([straight(name, (x, 0, 0), (along, 0, 0), 3.0, (0.2, 0.15), None, branch)])


@pytest.mark.parametrize("name", ["no-aorta", "two-trees"])
def test_a_lumen_without_an_aorta_is_a_case(shared, tmp_path, name):
    folder = shared / "cases" / name
    if not folder.is_dir():
        pytest.skip("needs ../shared/cases")
    findings, summary = check_case(folder / "case.yaml")
    assert findings == []
    told = [line for line in summary if "has no aorta; added one of radius" in line]
    assert len(told) == 1 and ("2 separate trees" in told[0]) == (name == "two-trees")
    prepare_case(folder / "case.yaml", Settings(), tmp_path / "case")
    network = read_json(tmp_path / "case" / "network.json")
    assert any(bc["bc_type"] == "ClosedLoopRCR" for bc in network["boundary_conditions"])


@pytest.mark.parametrize(("unit", "scale", "shift"), [("m", 0.01, 0.0), ("mm", 10.0, 0.0), ("cm", 1.0, 20.0)])
def test_the_lumen_is_the_same_in_any_unit_and_place(shared, tmp_path, unit, scale, shift):
    """Its points lie on a lattice, many on one sphere: rounding decides which of them are neighbours."""
    file = shared / "cases" / "no-aorta" / "lumen.stl"
    if not file.is_file():
        pytest.skip("needs ../shared/cases")
    mesh = pv.read(file)
    mesh.save(tmp_path / "given.stl")
    mesh.scale(scale).translate((shift, 0, 0)).save(tmp_path / "other.stl")
    radii = []
    for name, in_unit in (("given.stl", "cm"), ("other.stl", unit)):
        drafted = draft_anatomy(recognise(tmp_path / name), in_unit, set(), Settings())
        assert drafted.stenoses == []
        radii.append(sorted(float(np.median(v.radii)) for v in drafted.tree if not v.made))
    assert radii[0] == pytest.approx(radii[1], rel=0.02)


@pytest.mark.parametrize("apart", [2.0, 3.0, 5.0])
def test_former_roots_lie_on_the_wall_of_one_aorta(apart):
    left, right = tree_at(apart, "lca", "LAD"), tree_at(0.0, "rca", "RCA", -1.0)
    tree = with_aorta([left, right])
    made = [vessel for vessel in tree if vessel.made]
    assert made and tree.root.made
    for name, point in (("lca", (apart, 0, 0)), ("rca", (0, 0, 0))):
        assert np.allclose(tree[name].points[1], point)
        axis = tree[tree[name].parent].points[-1]
        assert np.linalg.norm(axis - point) == pytest.approx(made[0].radii[0], abs=1e-6)


def test_ostia_too_far_apart_for_an_aorta_are_refused():
    with pytest.raises(ValueError, match="too far for one aorta; are they in one frame"):
        with_aorta([tree_at(30.0, "lca", "LAD"), tree_at(0.0, "rca", "RCA", -1.0)])
