"""Vessels of the tree by the names that a reader knows: LAD, D1, LM."""

import re
from collections.abc import Iterable, Mapping

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel
from coronaryuq.case.case_json import CaseOutlet


def readable_names(tree: Tree, outlets: Iterable[CaseOutlet]) -> dict[str, str]:
    """Return the readable name of every vessel; the parts of an artery between bifurcations share its name.

    A vessel on the course of its artery has the artery's name. A side branch has the label of its outlet; upstream of
    several outlets, that of the outlet to which its own course leads.

    Parameters
    ----------
    tree
        The centreline tree.
    outlets
        Outlets of the case.
    """
    labels = {outlet.vessel: outlet.label for outlet in outlets}
    branches = {v.branch for v in tree} - {AORTA}
    main = {v.name: branch for branch in branches for v in course(tree, branch, labels) if v.branch == branch}
    return {vessel.name: _name(tree, vessel, labels, main) for vessel in tree}


def course(tree: Tree, artery: str, labels: Mapping[str, str]) -> list[Vessel]:
    """Return the vessels from the aorta along an artery to its own end; empty if the tree has none of it.

    Its own end is the one that has its name, or else of the dominant artery the PDA; else the end towards which most
    ends are fed. The left main ends at its bifurcation.

    Parameters
    ----------
    tree
        The centreline tree.
    artery
        Branch of the tree.
    labels
        Vessel that ends in an outlet → label of the outlet.
    """
    own = [vessel for vessel in tree if vessel.branch == artery]
    for label in (artery, "PDA"):
        ends = [vessel for vessel in own if labels.get(vessel.name) == label]
        if ends:
            return _coronary_path(tree, ends[0])
    starts = [vessel for vessel in own if vessel.parent is None or tree[vessel.parent].branch != artery]
    paths = [_coronary_path(tree, [v for v in _along(tree, start) if v.branch == artery][-1]) for start in starts]
    return max(paths, key=lambda path: sum(vessel.length for vessel in path), default=[])


def natural_key(name: str) -> tuple[str | int, ...]:
    """Return a key by which D2 comes before D10."""
    return tuple(int(word) if word.isdigit() else word for word in re.split(r"(\d+)", name))


def _coronary_path(tree: Tree, last: Vessel) -> list[Vessel]:
    return [vessel for vessel in tree.path(last.name) if vessel.branch != AORTA]


def _name(tree: Tree, vessel: Vessel, labels: dict[str, str], main: dict[str, str]) -> str:
    if vessel.branch == AORTA:
        return "aorta"
    if vessel.name in labels:
        return labels[vessel.name]
    if vessel.name in main:
        return main[vessel.name]
    return labels.get(_along(tree, vessel)[-1].name, vessel.branch)


def _along(tree: Tree, vessel: Vessel) -> list[Vessel]:
    """Return the course of a vessel to its end, along the children that feed most outlets, then the wider ones."""
    course = [vessel]
    while children := tree.children(course[-1].name):
        course.append(max(children, key=lambda child: (_ends(tree, child), float(child.radii.mean()), child.name)))
    return course


def _ends(tree: Tree, vessel: Vessel) -> int:
    return sum(not tree.children(part.name) for part in tree.subtree(vessel.name))
