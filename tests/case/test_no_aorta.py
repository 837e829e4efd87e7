"""Coronary trees without an aorta, one or two, become a case with an added aorta and a note on it."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.synthetic_aorta import with_aorta
from coronaryuq.case.anatomy.tree import Tree
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
