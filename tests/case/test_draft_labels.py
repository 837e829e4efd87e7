"""Artery, label and tissue of the ends of a tree, from names or from the course of the vessels."""

import re
import warnings
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from coronaryuq.case.anatomy.dominance import find_dominance, handedness_notes
from coronaryuq.case.anatomy.heart_frame import find_courses
from coronaryuq.case.anatomy.paths import Paths
from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.draft.labels import EndLabel, artery_of, label_ends
from coronaryuq.synthetic.anatomy import Anatomy, patient_anatomy
from coronaryuq.synthetic.arteries import PATTERNS
from support.case_files import small_tree, straight
from support.varied_trees import KINDS, anonymous, varied_anatomy


@pytest.mark.parametrize(
    ("name", "artery"),
    [
        ("LAD", "LAD"), ("lad_2", "LAD"), ("D1", "LAD"), ("Cx", "LCx"), ("OM2", "LCx"), ("RCA_distal", "RCA"),
        ("RV1", "RCA"), ("branch1", None), ("lca1", None), ("aorta", None), ("LADDER", None), ("PDA", None),
    ],
)  # fmt: skip
def test_a_name_tells_the_artery(name, artery):
    assert artery_of(name) == artery


def test_the_file_and_the_names_are_believed_first():
    labels = label_ends(small_tree(), ["lca1", "lca2", "rca1"])
    assert [labels[end].branch for end in ("lca1", "lca2", "rca1")] == ["LAD", "LCx", "RCA"]
    assert all(label.named and label.perfuses == "LV" for label in labels.values())


def test_without_names_the_tree_with_more_ends_is_the_left_one_and_its_far_part_the_lad():
    tree = anonymous(small_tree())[0]
    labels = label_ends(tree, ["v2", "v3", "v4"])
    assert [labels[end].branch for end in ("v2", "v3", "v4")] == ["LAD", "LCx", "RCA"]
    assert not any(label.named for label in labels.values())


def test_side_branches_are_numbered_along_the_course_and_the_distal_right_ones_perfuse_the_left_ventricle():
    vessels = [straight("v0", (0, 0, 0), (0, 0, 1), 2.0, (0.2, 0.2))]
    for k, z in enumerate((2.0, 3.0, 9.0)):
        vessels.append(
            straight(f"side{k}", (0, 0, z), (1, 0, 0), 0.5, (0.1, 0.1), vessels[0].name if not k else f"rca_{k}")
        )
        length = 4.0 if k == 2 else (3.0, 9.0)[k] - z
        name, parent = ("RCA" if k == 2 else f"rca_{k + 1}"), ("v0" if not k else f"rca_{k}")
        vessels.append(straight(name, (0, 0, z), (0, 0, 1), length, (0.18, 0.15), parent))
    labels = label_ends(Tree(vessels), ["side0", "side1", "side2", "RCA"])
    assert {end: (labels[end].label, labels[end].perfuses) for end in labels} == {
        "side0": ("RV1", "RV"), "side1": ("RV2", "RV"), "side2": ("PL1", "LV"), "RCA": ("RCA", "LV"),
    }  # fmt: skip


def kind(label: str) -> str:
    """A label without its number and letter."""
    return re.sub(r"\d+[a-z]?$", "", label)


def labelled(anatomy) -> tuple[dict[str, EndLabel], str | None]:
    """Labels of the outlets' vessels and dominance, found without any name."""
    tree, new = anonymous(anatomy.tree)
    found = label_ends(tree, [new[outlet.vessel] for outlet in anatomy.outlets])
    branches = {end: label.branch for end, label in found.items()}
    old = {name: vessel for vessel, name in new.items()}
    return {old[end]: label for end, label in found.items()}, find_dominance(tree, branches, {})


@pytest.mark.parametrize("dominance", ["right", "left"])
def test_arteries_side_branches_and_dominance_of_nameless_synthetic_patients_are_found(dominance):
    for seed in range(20):
        anatomy = patient_anatomy(seed, dominance, ())
        found, dominant = labelled(anatomy)
        assert dominant == dominance
        for outlet in anatomy.outlets:
            true = KINDS.get(outlet.label, kind(outlet.label))
            true = "PDA" if outlet.label == "LCx" and dominance == "left" else true
            label = found[outlet.vessel]
            assert (label.branch, kind(label.label)) == (outlet.branch, true), (seed, outlet)
            assert label.perfuses == outlet.perfuses, (seed, outlet)
            if true in ("D", "S", "OM"):
                assert label.label == outlet.label, (seed, outlet)


@pytest.mark.parametrize("dominance", ["right", "left", "co"])
def test_labels_stay_right_where_branches_are_missing_and_moved(dominance):
    """Of the ends 19 in 20 or more have their kind; in 1,200 further such trees it was 99.4 %."""
    right, dominant = [], []
    for seed in range(300, 308):
        case = varied_anatomy(seed, dominance)
        found, told = labelled(case.anatomy)
        dominant.append(told == case.dominance)
        for outlet in case.anatomy.outlets:
            assert found[outlet.vessel].branch == outlet.branch, (seed, outlet)
            right.append(kind(found[outlet.vessel].label) == kind(case.labels[outlet.vessel]))
    assert np.mean(right) >= 0.95 and np.mean(dominant) >= 0.85


@pytest.mark.parametrize("seed", [2015, 2358])
def test_what_leaves_a_posterolateral_trunk_is_posterolateral(seed):
    """A branch that crosses the PDA's line was one of the right ventricle."""
    case = varied_anatomy(seed, "right")
    found, _ = labelled(case.anatomy)
    assert {kind(found[o.vessel].label) for o in case.anatomy.outlets if o.label in ("PL1", "PL2")} == {"PL"}


def test_the_right_arterys_way_from_its_ostium_does_not_tilt_the_groove():
    """Its ostium lies above the groove: the apex was told too far forwards, and marginals to be posterolateral."""
    case = varied_anatomy(2, "co")
    paths, branches = Paths(case.anatomy.tree), {o.vessel: o.branch for o in case.anatomy.outlets}
    courses = find_courses(paths, branches)
    with patch("coronaryuq.case.anatomy.heart_frame.OSTIAL", 0.0):
        before = find_courses(paths, branches)
    to_apex = Anatomy.to_body_axes(np.array([0.0, 0.0, -1.0]))
    assert courses.frame.apex @ to_apex > before.frame.apex @ to_apex


def test_an_lad_that_winds_round_the_apex_is_the_lad():
    round_apex = ((140, 0.80, 0), (165, 0.90, 0), (215, 0.92, 0), (243, 0.86, 0))
    pattern = PATTERNS["right"]
    arteries = tuple(replace(a, course=a.course + round_apex) if a.name == "LAD" else a for a in pattern.arteries)
    with patch.dict(PATTERNS, winding=replace(pattern, arteries=arteries)):
        anatomy = patient_anatomy(5, "winding", ())
    found, dominant = labelled(anatomy)
    names = {outlet.label: found[outlet.vessel].label for outlet in anatomy.outlets}
    assert (names["LAD"], names["PDA"], names["D3"], names["S2"], dominant) == ("LAD", "PDA", "D3", "S2", "right")


def test_no_two_ends_have_the_same_label():
    """Right ventricular branches of the LAD and of the right coronary artery were both RV1."""
    over_right = ((131, 0.44, 0), (142, 0.50, 0), (153, 0.56, 0))
    pattern = PATTERNS["right"]
    arteries = tuple(replace(a, course=over_right) if a.name == "D2" else a for a in pattern.arteries)
    with patch.dict(PATTERNS, crossing=replace(pattern, arteries=arteries)):
        anatomy = patient_anatomy(3, "crossing", ())
    found, _ = labelled(anatomy)
    labels = [label.label for label in found.values()]
    assert {label.branch for label in found.values() if kind(label.label) == "RV"} == {"LAD", "RCA"}
    assert len({*labels}) == len(labels)


def test_a_label_that_the_files_give_to_one_end_is_not_offered_to_another():
    vessels = [straight("LAD_1", (0, 0, 0), (0, 0, 1), 2.0, (0.2, 0.2))]
    for k, (side, onwards) in enumerate([("x", "LAD_2"), ("D1", "LAD"), ("y", "lad"), ("z", "Lad")]):
        start = vessels[0].points[-1] + (0, 0, k)
        parent = vessels[0].name if k == 0 else vessels[-1].name
        vessels.append(straight(side, start, (1, 0, 0), 1.0, (0.1, 0.1), parent))
        vessels.append(straight(onwards, start, (0, 0, 1), 1.0, (0.18, 0.15), parent))
    tree = Tree(vessels)
    found = label_ends(tree, [v.name for v in tree.leaves()])
    assert (found["D1"].label, found["x"].label, found["y"].label) == ("D1", "D2", "D3")
    two = [straight("trunk", (0, 0, 0), (0, 0, 1), 2.0, (0.2, 0.2))]
    two += [straight(name, (0, 0, 2), (x, 0, 1), 3.0, (0.1, 0.1), "trunk") for name, x in (("cx", 1), ("LCx", 0))]
    assert sorted(end.label for end in label_ends(Tree(two), ["cx", "LCx"]).values()) == ["LCx", "LCx_2"]


@given(angles=st.tuples(*[st.floats(-180, 180)] * 3), shift=st.floats(-30, 30))
@settings(max_examples=5, deadline=None)
@example(angles=(-34.387691671735695, 84.25, 2.4375), shift=20.0)  # two ends of one fork, equal but for rounding
def test_labels_do_not_depend_on_the_frame_of_the_files(angles, shift):
    anatomy = patient_anatomy(3, "right", ())
    turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    moved = Tree(replace(v, points=v.points @ turn.T + shift) for v in anatomy.tree)
    assert labelled(replace(anatomy, tree=moved)) == labelled(anatomy)


def test_without_all_three_arteries_or_a_groove_no_directions_are_told():
    tree = small_tree()
    branches = {"lca1": "LAD", "lca2": "LCx", "rca1": "RCA"}
    assert find_courses(Paths(tree), {"lca1": "LAD", "lca2": "LCx"}) is None
    tiny = Tree(replace(v, points=v.points / 5, radii=v.radii / 5) for v in tree)
    assert find_courses(Paths(tiny), branches) is None and find_dominance(tiny, branches, {}) is None


@given(seed=st.integers(0, 10**6), kind=st.sampled_from(["free", "flat", "line", "lattice"]))
@example(seed=29, kind="lattice")
@settings(max_examples=50, deadline=None)
def test_a_tree_that_is_no_heart_is_labelled_without_a_fault(seed, kind):
    random, vessels = np.random.default_rng(seed), [straight("aorta", (0, 0, 0), (0, 0, 1), 2.0, (1.2, 1.2))]

    def grow(name: str, parent: str, start: np.ndarray, length: float) -> None:
        direction = random.normal(size=3) * (1, 1, 0 if kind == "flat" else 1)
        if kind == "line":
            direction = np.array([1.0 if name[0] == "l" else -1.0, 0.0, 0.0])
        if kind == "lattice":
            direction = np.round(direction) if np.round(direction).any() else np.array([0.0, 1.0, 0.0])
        vessel = straight(name, start, direction, length, (0.1, 0.1), parent, points=int(random.integers(2, 30)))
        vessels.append(vessel)
        for child in range(int(random.integers(1, 4)) if len(name) < 4 and random.random() < 0.8 else 0):
            grow(f"{name}{child}", name, vessel.points[-1], length * random.uniform(0.1, 1.2))

    for side in "lrq"[: int(random.integers(1, 4))]:
        grow(side, "aorta", vessels[0].points[-1], float(random.uniform(0.3, 5)))
    tree = Tree(vessels)
    ends = [v.name for v in tree.leaves() if v.name != "aorta"]
    found = label_ends(tree, ends)
    assert {*found} == {*ends} and len({end.label for end in found.values()}) == len(ends)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        find_dominance(tree, dict(zip(ends, random.choice(["LAD", "LCx", "RCA"], len(ends)), strict=True)), {})


@pytest.mark.parametrize(
    ("labels", "dominance"),
    [({"rca1": "PDA"}, "right"), ({"lca2": "L-PDA"}, "left"), ({"rca1": "RPDA", "lca2": "LPDA"}, "co"), ({}, None)],
)
def test_an_outlet_that_is_called_pda_tells_the_dominance(labels, dominance):
    tree = Tree(replace(v, points=v.points / 5, radii=v.radii / 5) for v in small_tree())
    assert find_dominance(tree, {"lca1": "LAD", "lca2": "LCx", "rca1": "RCA"}, labels) == dominance


@pytest.mark.parametrize("dominance", ["right", "left", "co"])
def test_the_mirror_image_of_a_heart_is_noted(dominance):
    anatomy = varied_anatomy(7, dominance).anatomy
    branches = {outlet.vessel: outlet.branch for outlet in anatomy.outlets}
    assert handedness_notes(anatomy.tree, branches) == ()
    flipped = Tree(replace(v, points=v.points * [-1, 1, 1]) for v in anatomy.tree)
    exchanged = Tree(replace(v, points=v.points[:, ::-1]) for v in anatomy.tree)
    for tree in (flipped, exchanged):
        (told,) = handedness_notes(tree, branches)
        assert "mirror image" in told and "one axis flipped" in told and "two exchanged" in told
    turned = Tree(replace(v, points=v.points * [-1, -1, 1]) for v in anatomy.tree)  # as between RAS and LPS
    assert handedness_notes(turned, branches) == ()


@pytest.mark.parametrize("pair", [("LAD", "LCx"), ("LCx", "RCA")])
def test_exchanged_names_of_arteries_also_make_a_heart_look_mirrored(pair):
    anatomy = varied_anatomy(7, "right").anatomy
    others = {artery: artery for artery in ("LAD", "LCx", "RCA")} | dict([pair, pair[::-1]])
    (told,) = handedness_notes(anatomy.tree, {outlet.vessel: others[outlet.branch] for outlet in anatomy.outlets})
    assert " and ".join(pair) in told
