"""Which artery feeds the back of the heart."""

import re
from collections.abc import Mapping
from dataclasses import replace

from coronaryuq.case.anatomy.heart_frame import REACH, Courses, find_courses, is_inferior, reach
from coronaryuq.case.anatomy.paths import Paths
from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.case_json import Branch, Dominance

WORDS: dict[Dominance, str] = {
    "right": "right (the posterior descending artery comes from the RCA)",
    "left": "left (the posterior descending artery comes from the LCx)",
    "co": "co-dominant (RCA and LCx both feed the inferior wall)",
}


def find_dominance(tree: Tree, branches: Mapping[str, Branch], labels: Mapping[str, str]) -> Dominance | None:
    """Return the dominance of a coronary tree; None where no posterior descending artery (PDA) is to be seen.

    Parameters
    ----------
    tree
        Vessels, cm.
    branches
        Coronary end → its artery.
    labels
        Coronary end → its label; one that is called PDA is believed to be one.
    """
    called = [end for end in branches if re.fullmatch(r"[lr]?-?pda\d*", labels.get(end, "").lower())]
    sides = {branches[end] for end in called}
    if sides >= {"RCA", "LCx"}:
        return "co"
    paths = Paths(tree)
    courses = find_courses(paths, branches)
    if courses is None:
        return "right" if sides == {"RCA"} else "left" if sides == {"LCx"} else None
    return _by_place(paths, branches, replace(courses, pda=called[0]) if called else courses)


def handedness_notes(tree: Tree, branches: Mapping[str, Branch]) -> tuple[str, ...]:
    """Return a note if the arteries lie as in the mirror image of a heart. branches: coronary end → its artery.

    The arteries alone cannot tell a mirrored file from exchanged names.
    """
    courses = find_courses(Paths(tree), branches)
    if courses is None or not courses.mirrored:
        return ()
    return (
        "anatomy: LAD, LCx and RCA lie as in the mirror image of a heart: either the file is mirrored (one axis "
        "flipped, or two exchanged), or two arteries have each other's name (LAD and LCx, or LCx and RCA); in situs "
        "inversus it is right",
    )


def _by_place(paths: Paths, branches: Mapping[str, Branch], courses: Courses) -> Dominance | None:
    """Return the dominance by the places of the ends.

    It is that of the artery with the PDA. If that is the right coronary artery, but only the circumflex has branches on
    the inferior wall of the left ventricle, both share it.
    """
    if courses.pda is None:
        return None
    if branches[courses.pda] == "LCx":
        return "left"
    enough = REACH * reach(paths, courses.lad, courses.frame)
    feed = {
        branches[end]
        for end in branches
        if is_inferior(paths, end, courses) and float(courses.frame.height(paths.tree[end].points[-1])) >= enough
    }
    return "co" if "LCx" in feed and "RCA" not in feed else "right"
