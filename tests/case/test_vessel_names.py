"""Vessels have the names that a reader knows."""

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, Vessel
from coronaryuq.case.anatomy.vessel_names import readable_names
from coronaryuq.case.case_json import CaseOutlet


def vessel(name, parent, branch, start, end, radius=0.1):
    return Vessel(name, np.array([start, end], float), np.array([radius, radius]), parent, branch)


def outlet(name, label, branch):
    return CaseOutlet(
        name=name, label=label, bc=f"BC_{name}", vessel=name, block=name, perfuses="LV", branch=branch, point=(0, 0, 0),
        radius=0.1,
    )  # fmt: skip


def test_an_artery_keeps_its_name_past_bifurcations_and_a_side_branch_has_its_outlets():
    tree = Tree(
        [
            vessel("aorta", None, "aorta", (0, 0, 0), (0, 0, 1), 1.0),
            vessel("branch1_seg0", "aorta", "LM", (0, 0, 1), (2, 0, 1)),
            vessel("branch2_seg0", "branch1_seg0", "LAD", (2, 0, 1), (4, 0, 1)),
            vessel("a", "branch2_seg0", "LAD", (4, 0, 1), (6, 0, 1)),
            vessel("b", "branch2_seg0", "LAD", (4, 0, 1), (5, 1, 1)),
            vessel("c", "branch1_seg0", "LCx", (2, 0, 1), (2, 3, 1)),
            vessel("trunk", "a", "LAD", (6, 0, 1), (7, 1, 1)),
            vessel("d", "trunk", "LAD", (7, 1, 1), (8, 1, 1), 0.05),
            vessel("e", "trunk", "LAD", (7, 1, 1), (8, 2, 1), 0.08),
            vessel("f", "a", "LAD", (6, 0, 1), (8, 0, 1)),
        ]
    )
    outlets = [
        outlet("b", "D1", "LAD"), outlet("c", "LCx", "LCx"), outlet("d", "D2", "LAD"), outlet("e", "D3", "LAD"),
        outlet("f", "LAD", "LAD"),
    ]  # fmt: skip
    names = readable_names(tree, outlets)
    assert names == {
        "aorta": "aorta", "branch1_seg0": "LM", "branch2_seg0": "LAD", "a": "LAD", "b": "D1", "c": "LCx", "trunk": "D3",
        "d": "D2", "e": "D3", "f": "LAD",
    }  # fmt: skip


def test_an_artery_without_an_outlet_of_its_name_runs_where_most_outlets_are_fed():
    tree = Tree(
        [
            vessel("root", None, "RCA", (0, 0, 0), (1, 0, 0)),
            vessel("conus", "root", "RCA", (1, 0, 0), (1, 1, 0), 0.2),
            vessel("mid", "root", "RCA", (1, 0, 0), (2, 0, 0)),
            vessel("pda", "mid", "RCA", (2, 0, 0), (3, 0, 0)),
            vessel("pl", "mid", "RCA", (2, 0, 0), (3, 1, 0), 0.05),
        ]
    )
    outlets = [outlet("conus", "conus", "RCA"), outlet("pda", "PDA", "RCA"), outlet("pl", "PL", "RCA")]
    names = readable_names(tree, outlets)
    assert names == {"root": "RCA", "mid": "RCA", "conus": "conus", "pda": "PDA", "pl": "PL"}
