"""Vessels of the tree by the names that a reader knows: LAD, D1, LM."""

from collections.abc import Iterable

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
    main = {name: branch for branch in {v.branch for v in tree} - {AORTA} for name in _course_of(tree, branch, labels)}
    return {vessel.name: _name(tree, vessel, labels, main) for vessel in tree}


def _name(tree: Tree, vessel: Vessel, labels: dict[str, str], main: dict[str, str]) -> str:
    if vessel.branch == AORTA:
        return "aorta"
    if vessel.name in labels:
        return labels[vessel.name]
    if vessel.name in main:
        return main[vessel.name]
    return labels.get(_along(tree, vessel)[-1].name, vessel.branch)


def _course_of(tree: Tree, branch: str, labels: dict[str, str]) -> list[str]:
    """Return the vessels along an artery: to the outlet that has its name, or else where most outlets are fed."""
    own = [vessel for vessel in tree if vessel.branch == branch]
    for vessel in own:
        if labels.get(vessel.name) == branch:
            return [part.name for part in tree.path(vessel.name) if part.branch == branch]
    starts = [vessel for vessel in own if vessel.parent is None or tree[vessel.parent].branch != branch]
    course = [part for start in starts for part in _along(tree, start)]
    return [part.name for part in course if part.branch == branch and part.name not in labels]


def _along(tree: Tree, vessel: Vessel) -> list[Vessel]:
    """Return the course of a vessel to its end, along the children that feed most outlets, then the wider ones."""
    course = [vessel]
    while children := tree.children(course[-1].name):
        course.append(max(children, key=lambda child: (_ends(tree, child), float(child.radii.mean()), child.name)))
    return course


def _ends(tree: Tree, vessel: Vessel) -> int:
    return sum(not tree.children(part.name) for part in tree.subtree(vessel.name))
