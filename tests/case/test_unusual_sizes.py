"""Sizes that are possible but rare are noted by `check`; usual ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import Tree
from support.case_files import check_case, straight, write_case

SIZES = ("left ventricle: a wall", "left ventricle: ", "in diameter, as only", "aorta: ")


def notes_of(folder, tree, volumes=(60, 40, 40), flow=(90, 60, 40)):
    """Return the notes on sizes of a case with these territories."""
    path = write_case(folder, tree, perfusion=None, territory_flows="{file: flows.csv, unit: mL/min}")
    rows = zip(("lca1", "lca2", "rca1"), flow, volumes, strict=True)
    (folder / "flows.csv").write_text("name,flow,volume\n" + "".join(f"{n},{q},{v}\n" for n, q, v in rows))
    findings, lines = check_case(path)
    assert findings == []
    said = [line.removeprefix("note: ") for line in lines if line.startswith("note: ")]
    return [line for line in said if any(words in line for words in SIZES)]


def test_usual_sizes_are_not_noted(small_tree, tmp_path):
    assert notes_of(tmp_path, small_tree) == []


@pytest.mark.parametrize(
    ("volumes", "flow", "words"),
    [
        ((300, 200, 126), (900, 600, 400), "a wall of 657 g, where most adults have 40 to 350 g"),
        ((12, 8, 8), (40, 20, 20), "a wall of 29.4 g"),
        ((60, 40, 40), (20, 14, 14), "0.33 mL/min/g on average, where most have 0.4 to 6"),
        ((60, 40, 40), (500, 300, 300), "7.5 mL/min/g on average"),
    ],
)
def test_a_rare_ventricle_is_noted(small_tree, tmp_path, volumes, flow, words):
    (told,) = notes_of(tmp_path, small_tree, volumes, flow)
    assert words in told


def test_a_giant_aneurysm_is_noted_and_the_flare_inside_the_aorta_is_not(small_tree, tmp_path):
    def wide(name, points):
        vessel = small_tree[name]
        return replace(vessel, radii=np.where(np.isin(np.arange(len(vessel.radii)), points), 0.6, vessel.radii))

    (told,) = notes_of(tmp_path, small_tree.with_vessels({"lca1": wide("lca1", [10])}))
    assert "vessel lca1: 12 mm in diameter, as only giant aneurysms have" in told
    assert notes_of(tmp_path, small_tree.with_vessels({"rca1": wide("rca1", [0, 1])})) == []
    (told,) = notes_of(tmp_path, small_tree.with_vessels({"rca1": wide("rca1", [60])}))
    assert "vessel rca1: 12 mm" in told


def test_an_inlet_that_is_no_aorta_is_noted(small_tree, tmp_path):
    thin = Tree(replace(v, radii=v.radii / 3) if v.branch == "aorta" else v for v in small_tree)
    (told,) = notes_of(tmp_path, thin)
    assert "aorta: 0.8 cm in diameter at its inlet, where most adults have 1.5 to 6" in told


def test_an_aorta_that_runs_backwards_is_noted(small_tree, tmp_path):
    def moved(vessel, shift):
        return replace(vessel, points=vessel.points + [0, 0, shift])

    first = straight("aorta", (0, 0, 0), (0, 0, 1), 9.0, (1.2, 1.2))
    rest = [moved(v, 7.0) for v in small_tree if v.name not in ("aorta", "aorta_outlet")]
    last = straight("aorta_outlet", (0, 0, 9), (0, 0, 1), 2.0, (1.2, 1.2), "aorta")
    (told,) = notes_of(tmp_path, Tree([first, *rest, last]))
    assert told.startswith("aorta: the first artery leaves it 9 cm from its start and 2 cm from its end; does it run")
