"""Places of a pressure wire: where they lie on the tree, and what is told where they cannot."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import Tree, Vessel
from coronaryuq.case.anatomy.vessel_names import course
from coronaryuq.case.anatomy.wire_places import distance_from_ostium, place_along
from coronaryuq.case.case_json import read_case
from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from support.case_files import check_case, small_tree, write_case

OSTIUM = small_tree().emergence("branch1")
"""cm: the left main leaves the aorta here, 1.2 cm from its axis."""


def located(folder, entries: str, **changes: str):
    path = write_case(folder, small_tree(), ffr_at=entries, **changes)
    prepare_case(path, Settings(), folder / "case")
    return read_case(folder / "case" / "case.json").ffr_at


def test_a_distance_counts_from_the_ostium_through_the_left_main(tmp_path):
    near, far, right = located(
        tmp_path,
        "[{artery: LAD, distance: 0.5}, {name: distal LAD, artery: LAD, distance: 4.5, measured: 0.84, sd: 0.02}, "
        "{artery: RCA, distance: 0}]",
    )
    assert (near.name, near.artery, near.vessel) == ("LM 0.5 cm", "LM", "branch1")
    assert near.arc == pytest.approx(OSTIUM + 0.5)
    assert (far.name, far.vessel, far.measured, far.sd) == ("distal LAD", "lca1", 0.84, 0.02)
    assert far.arc == pytest.approx(4.5 - (3.2 - OSTIUM)) and far.distance == 4.5
    assert (right.vessel, right.arc) == ("rca1", small_tree().emergence("rca1"))


def test_a_point_is_in_the_anatomys_frame_and_unit(tmp_path):
    tree = small_tree()
    in_mm = Tree(Vessel(v.name, v.points * 10, v.radii * 10, v.parent, v.branch) for v in tree)
    path = write_case(
        tmp_path, in_mm, anatomy="{centrelines: tree.vtp, unit: mm}", ffr_at="[{point: [47.5, 15.5, 20.3]}]",
        stenoses="[{name: LCx, vessel: lca2, start: 0.5, end: 1.0}]",
    )  # fmt: skip
    prepare_case(path, Settings(), tmp_path / "case")
    (place,) = read_case(tmp_path / "case" / "case.json").ffr_at
    assert (place.vessel, place.artery) == ("lca2", "LCx")
    assert place.arc == pytest.approx(1.55 * 2**0.5, abs=1e-9)
    assert place.name == f"lca2 {place.distance:.1f} cm"


WRONG = {
    "no such artery": (
        "[{artery: Cx, distance: 1}]",
        "ffr_at.0.artery = 'Cx': input should be 'LM', 'LAD', 'LCx' or 'RCA'",
    ),
    "an artery that the tree lacks": (
        "[{artery: LCx, distance: 1}]",
        "ffr_at.0.artery = 'LCx': the tree has no vessel of it; it has LAD, RCA; or give point",
    ),
    "beyond the end": (
        "[{name: far, artery: RCA, distance: 9}]",
        "ffr_at.far.distance = 9.0: beyond the end of the RCA, 5.00 cm from its ostium; if 9 is in mm, write 0.9",
    ),
    "far from all": (
        "[{point: [0, 9, 2]}]",
        "ffr_at.0.point = (0.0, 9.0, 2.0): lies 8.7 cm from the nearest coronary artery (lca2); check the point and",
    ),
    "one name twice": (
        "[{name: a, artery: RCA, distance: 1}, {name: A, artery: RCA, distance: 2}]",
        "ffr_at.A = 'A': another place has this name",
    ),
    "one place twice": (
        "[{artery: RCA, distance: 1}, {artery: RCA, distance: 1.01}]",
        "ffr_at.1 = 'rca1 1.0 cm': another place has this name; give each a name of its own",
    ),
    "half a distance": ("[{artery: LAD}]", "ffr_at.0: give artery and distance (cm from the ostium), or point"),
    "both ways": (
        "[{artery: LAD, distance: 2, point: [3, 0, 2]}]",
        "ffr_at.0: give artery and distance (cm from the ostium), or point",
    ),
    "sd alone": ("[{artery: LAD, distance: 2, sd: 0.02}]", "ffr_at.0: give sd only with measured"),
    "percent": (
        "[{artery: LAD, distance: 2, measured: 84}]",
        "ffr_at.0.measured = 84: input should be less than or equal to 1.2; if 84 is in %, write 0.84",
    ),
    "before the ostium": (
        "[{artery: LAD, distance: -2}]",
        "ffr_at.0.distance = -2: input should be greater than or equal to 0",
    ),
    "unknown field": (
        "[{artery: LAD, distence: 2}]",
        "ffr_at.0.distence = 2: unknown field; did you mean distance? known fields: name, artery",
    ),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_place_that_is_none_is_one_line(tmp_path, mistake):
    entries, expected = WRONG[mistake]
    path = write_case(tmp_path, small_tree(), ffr_at=entries)
    if "lacks" in mistake:
        table = tmp_path / "outlets.csv"
        table.write_text(table.read_text().replace("LCx", "LAD"))
    findings, _ = check_case(path)
    assert len(findings) == 1 and findings[0].startswith(f"{path}: {expected}"), findings


def test_a_network_alone_has_no_places(tmp_path):
    path = write_case(
        tmp_path, small_tree(), anatomy=None, network="loop.json", stenoses="[]", ffr_at="[{artery: LAD, distance: 1}]"
    )
    assert "ffr_at needs an anatomy" in check_case(path)[0][0]


def test_check_says_where_each_place_was_found(tmp_path):
    entries = "[{name: wire, artery: LAD, distance: 3.5, measured: 0.84, sd: 0.02}, {artery: LCx, distance: 4}]"
    findings, lines = check_case(write_case(tmp_path, small_tree(), ffr_at=entries))
    assert findings == []
    told = [line for line in lines if line.startswith("FFR at ")]
    assert told[0] == (
        "FFR at wire: LAD, vessel lca1 at 1.50 cm, 3.50 cm from the ostium, 2.9 mm in diameter, inside the LAD "
        "stenosis; measured 0.84 (sd 0.02)"
    )
    assert told[1].startswith("FFR at lca2 4.0 cm: LCx, vessel lca2 at 2.00 cm") and told[1].endswith("; none measured")


@given(vessel=st.sampled_from(["lca1", "lca2", "rca1"]), shares=st.lists(st.floats(0, 1), min_size=2, max_size=2))
def test_a_distance_and_its_place_are_one_to_one(vessel, shares):
    tree = small_tree()
    vessels = course(tree, tree[vessel].branch, {})
    parts = [(v, tree.emergence(v.name)) for v in vessels]
    whole = distance_from_ostium(tree, vessel, tree[vessel].length)
    near, far = (place_along(parts, share * whole) for share in sorted(shares))
    order = [v.name for v in vessels]
    assert (order.index(near[0]), near[1]) <= (order.index(far[0]), far[1])
    for (name, arc), share in ((near, min(shares)), (far, max(shares))):
        assert distance_from_ostium(tree, name, arc) == pytest.approx(share * whole, abs=1e-9)
    assert place_along(parts, whole + 1e-3) is None
