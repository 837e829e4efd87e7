"""Several stenoses of one artery, and of the left main: named, found, placed in the network."""

import json

import numpy as np
import pytest

from coronaryuq.case.anatomy.stenosis_detection import detected_stenoses
from coronaryuq.case.anatomy.tree import Stenosis
from coronaryuq.case.case_json import read_case
from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.synthetic.anatomy import narrowed
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.stage import ffr_locations
from support.case_files import check_case, straight, write_case

PLACES = (
    ("branch1", 1.6, 2.4, 0.4),
    ("lca1", 0.6, 1.4, 0.4),
    ("lca1", 2.2, 3.0, 0.5),
    ("rca1", 2.0, 3.0, 0.15),
    ("rca1", 4.0, 5.0, 0.2),
)
"""Vessel, start and end (cm), and lost share of the diameter."""


@pytest.fixture
def serial_tree(small_tree):
    even = {}
    for vessel in dict.fromkeys(place[0] for place in PLACES):
        old = small_tree[vessel]
        ends = old.points[0], old.points[-1] - old.points[0]
        even[vessel] = straight(vessel, *ends, old.length, (0.18, 0.18), old.parent, old.branch, 161)
    for vessel, start, end, share in PLACES:
        even[vessel] = narrowed(even[vessel], Stenosis("any", vessel, start, end), share)
    return small_tree.with_vessels(even)


def case_of(folder, tree, stenoses):
    prepare_case(write_case(folder, tree, stenoses=stenoses), Settings(), folder / "case")
    return read_case(folder / "case" / "case.json")


def test_serial_stenoses_have_their_names_and_places(serial_tree, tmp_path):
    listed = (
        "[{name: LAD2, vessel: lca1, start: 2.2, end: 3.0}, {name: LAD, vessel: lca1, start: 0.6, end: 1.4}, "
        "{name: lm, vessel: branch1, start: 1.6, end: 2.4}, {name: distal, artery: RCA, point: [-4.5, 0, 2]}]"
    )
    case = case_of(tmp_path, serial_tree, listed)
    assert [(s.name, s.artery) for s in case.stenoses] == [
        ("LM", "LM"), ("LAD", "LAD"), ("LAD2", "LAD"), ("distal", "RCA"),
    ]  # fmt: skip
    main, first, second, right = case.stenoses
    assert main.outlet == first.outlet == second.outlet == "BC_lca1" and right.outlet == "BC_rca1"
    assert main.root == "aorta:branch1_seg0" or main.root.endswith(":branch1_seg0")
    assert first.distal != second.distal and len({s.segment for s in case.stenoses}) == 4
    network = read_network(tmp_path / "case" / "network.json")
    lossy = [v for v in network.vessels if v["zero_d_element_values"]["stenosis_coefficient"] > 0]
    lossy = [v["vessel_name"] for v in lossy if v.get("entrance", 0.0) < 1.0]
    assert sorted(lossy) == sorted(s.segment for s in case.stenoses)
    places = ffr_locations(case)
    assert list(places) == ["ffr_lm", "ffr_lad", "ffr_lad2", "ffr_distal"]
    names = [f"mean_pressure:{at}" for at in (case.aorta.pressure, *places.values())]
    pressures = Engine(network).run_cycles(quantities=names, cycles=4, steps_per_cycle=200).values
    aorta, main, first, second, _ = (pressures[name][0] for name in names)
    assert aorta > main > first > second


def test_auto_numbers_serial_stenoses_from_the_ostium_on_and_finds_those_of_the_left_main(serial_tree):
    found = {s.name: s for s in detected_stenoses(serial_tree, 0.75, 0.5, {})}
    assert list(found) == ["LM", "LAD", "LAD2", "RCA"]
    middle = {name: (s.start + s.end) / 2 for name, s in found.items()}
    assert middle == pytest.approx({"LM": 2.0, "LAD": 1.0, "LAD2": 2.6, "RCA": 4.5}, abs=0.1)
    assert [s.name for s in detected_stenoses(serial_tree, 0.75, 0.0, {})] == ["LAD", "RCA"]


@pytest.mark.parametrize(
    ("stenoses", "message"),
    [
        (
            "[{name: LAD, vessel: lca1, start: 0.6, end: 1.4}, {name: lad, vessel: lca1, start: 2.2, end: 3.0}]",
            "stenoses has LAD twice; give each its own name, such as LAD2",
        ),
        ("[{name: LAD2, artery: LCx, vessel: lca1, start: 0.6, end: 1.4}]", "belongs to the LAD, not the LCx"),
        ("[{name: one, vessel: aorta, start: 0.6, end: 1.4}]", "belongs to the aorta; choose a coronary artery"),
        ("[{name: one two, vessel: lca1, start: 0.6, end: 1.4}]", "stenoses.0.name = 'one two'"),
    ],
)
def test_stenoses_that_cannot_be_told_apart_or_placed_are_refused(serial_tree, tmp_path, stenoses, message):
    findings, _ = check_case(write_case(tmp_path, serial_tree, stenoses=stenoses))
    assert len(findings) == 1 and message in findings[0]


def test_one_stenosis_for_each_artery_is_the_same_case_as_before(small_tree, tmp_path):
    listed = "[{name: RCA, vessel: rca1, start: 3.0, end: 4.0}, {name: LAD, vessel: lca1, start: 1.0, end: 2.0}]"
    case = case_of(tmp_path, small_tree, listed)
    assert [s.name for s in case.stenoses] == ["LAD", "RCA"]
    assert json.loads((tmp_path / "case" / "case.json").read_text())["stenoses"][0]["artery"] == "LAD"
    assert np.isclose(case.stenoses[0].start, 1.0)
