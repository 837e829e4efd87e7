"""Artery, label and tissue of the ends of a tree, from names or from the course of the vessels."""

from dataclasses import replace

import pytest

from coronaryuq.case.anatomy.tree import AORTA, Tree
from coronaryuq.case.draft.labels import artery_of, label_ends
from coronaryuq.synthetic.anatomy import patient_anatomy
from support.case_files import small_tree, straight


def without_names(tree: Tree) -> Tree:
    """The same tree with vessels called v0, v1, ... and no branches."""
    new = {v.name: f"v{k}" for k, v in enumerate(tree)}
    return Tree(replace(v, name=new[v.name], parent=new.get(v.parent), branch=AORTA) for v in tree)


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
    tree = without_names(small_tree())
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


@pytest.mark.parametrize("dominance", ["right", "left"])
def test_the_arteries_of_nameless_synthetic_patients_are_found(dominance):
    for seed in range(20):
        anatomy = patient_anatomy(seed, dominance, ())
        new = {v.name: f"v{k}" for k, v in enumerate(anatomy.tree)}
        true = {new[outlet.vessel]: outlet.branch for outlet in anatomy.outlets}
        labels = label_ends(without_names(anatomy.tree), list(true))
        assert {end: label.branch for end, label in labels.items()} == true, seed
