"""Artery, label and tissue of every coronary end: from the names in the files, else from the course of the vessels."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from coronaryuq.case.anatomy.heart_frame import Courses, apical_middle, departure, find_courses, is_inferior
from coronaryuq.case.anatomy.paths import Paths, first_part, in_groove_with, off_plane
from coronaryuq.case.anatomy.tree import AORTA, Tree
from coronaryuq.case.case_json import Branch, Tissue

BRANCHES: tuple[Branch, ...] = get_args(Branch)
NAMED: dict[str, str] = {
    "LAD": r"lad\d*|d\d+[a-z]?|dia(g\w*)?\d*|s\d+|sept\w*",
    "LCx": r"l?cx\d*|circ\w*|om\d*[a-z]?|obtuse\w*",
    "RCA": r"rca\d*|right|rv\d*|am\d*|acute\w*|conus\w*",
    "left": r"lca\d*|left|lmc?a?|lmain",
    "distal": r"r?pda\d*|r?plv?b?\d*[a-z]?|posterolat\w*",
}
"""Words in the names of vessels that tell the artery, or at least the side; `distal` are those of the dominant one."""
RIGHT_HEART, SEPTUM = r"rv\d*|am\d*|acute\w*|conus\w*", r"s\d+|sept\w*"
"""Words for what perfuses the right ventricle, and the septum."""
LIKELY: dict[Branch, str] = {"LAD": "D", "LCx": "OM", "RCA": "RV"}
"""Label of the side branches of an artery."""
TISSUES: dict[str, Tissue] = {"RV": "RV", "S": "septum"}
"""Tissue of the kinds of side branches that do not perfuse the left ventricle."""
CRUX = 0.5
"""Fraction of the length of the right coronary artery beyond which its branches perfuse the left ventricle, where the
left arteries are not there to tell the heart's directions."""


@dataclass(frozen=True)
class EndLabel:
    """What an end of the tree is: artery and tissue (None: unknown), its usual label, whether its name says so.

    No two ends of a tree have the same label.
    """

    branch: Branch | None
    label: str
    perfuses: Tissue | None
    named: bool


def label_ends(tree: Tree, ends: Sequence[str], names_tell: bool = True) -> dict[str, EndLabel]:
    """Label the coronary ends of a tree.

    An end belongs to the artery that the file or a name on its way to the aorta tells, the nearest first. If none does,
    the tree with more ends is the left one. Of its two parts the LCx is the one that lies in a plane with the right
    coronary artery, because both run in the groove between atria and ventricles; without a right one, the LAD is the
    part with the end farthest from the ostium, because it runs to the apex.

    Parameters
    ----------
    tree
        Vessels, cm, with or without an aorta.
    ends
        Names of the coronary ends.
    names_tell
        Whether names and branches of the vessels are the patient's, and not made while a surface was read.
    """
    branches: dict[str, tuple[Branch | None, bool]] = {}
    for end in ends:
        names = ((v.name, v.branch) for v in reversed(tree.path(end)) if names_tell)
        known = next((found for name, branch in names if (found := artery_of(name, branch))), None)
        branches[end] = (known, known is not None)
    paths = Paths(tree)
    by_place = _by_place(paths, ends, {end: branch for end, (branch, _) in branches.items()})
    branches |= {end: (branch, False) for end, branch in by_place.items()}
    labels: dict[str, EndLabel] = {}
    numbers = _Numbers(ends)
    courses = find_courses(paths, known_branches := {end: b for end, (b, _) in branches.items() if b is not None})
    for branch in BRANCHES:
        own = [end for end in known_branches if known_branches[end] == branch]
        for end, (label, perfuses) in _along_artery(paths, own, branch, courses, numbers).items():
            labels[end] = EndLabel(branch, label, perfuses, branches[end][1])
    return _unique({end: labels.get(end) or EndLabel(None, end, None, False) for end in ends})


class _Numbers:
    """Numbers of side branches, which go on from artery to artery and leave out those that the files' names have."""

    def __init__(self, ends: Sequence[str]) -> None:
        self._taken = {end.lower() for end in ends}
        self._last: Counter[str] = Counter()

    def next(self, stem: str) -> str:
        """Return the kind of a branch with its next free number."""
        self._last[stem] += 1
        label = f"{stem}{self._last[stem]}"
        return self.next(stem) if label.lower() in self._taken else label


def _unique(labels: dict[str, EndLabel]) -> dict[str, EndLabel]:
    """Return the labels with a number behind those that another end has; a name in the files keeps its own."""
    found: dict[str, EndLabel] = {}
    taken: set[str] = set()
    for end in sorted(labels, key=lambda end: labels[end].label.lower() != end.lower()):
        label = free_name(labels[end].label, taken)
        found[end] = replace(labels[end], label=label)
    return {end: found[end] for end in labels}


def free_name(name: str, taken: set[str]) -> str:
    """Return a name, with a number behind it if it is taken whatever its capitals, and add it to `taken`."""
    free = next(c for k in range(len(taken) + 1) if (c := name if not k else f"{name}_{k + 1}").lower() not in taken)
    taken.add(free.lower())
    return free


def artery_of(name: str, branch: str = AORTA) -> Branch | None:
    """Return the artery that a file states (`branch`) or a vessel's name tells."""
    for artery in BRANCHES:
        if branch == artery or says(name, NAMED[artery]):
            return artery
    return None


def says(name: str, pattern: str) -> bool:
    """Return whether one of the words of a name matches."""
    return any(re.fullmatch(pattern, word) for word in re.split(r"[^a-z0-9]+", name.lower()))


def tissue_of(name: str, branch: Branch | None) -> Tissue | None:
    """Return the tissue that an end perfuses as far as its name and its artery tell."""
    if says(name, RIGHT_HEART):
        return "RV"
    if says(name, SEPTUM):
        return "septum"
    return "LV" if branch in ("LAD", "LCx") or says(name, NAMED["distal"]) else None


def _by_place(paths: Paths, ends: Sequence[str], known: dict[str, Branch | None]) -> dict[str, Branch]:
    """Return the artery of the ends of which no name tells it."""
    tree = paths.tree
    starts: dict[str, list[str]] = {}
    for end in ends:
        starts.setdefault(_ostium(paths, end, ends), []).append(end)
    sides = _sides(tree, starts, known)
    root = np.mean([tree[start].points[0] for start in starts], axis=0)
    found: dict[str, Branch] = {}
    for start, own in starts.items():
        unknown = [end for end in own if known[end] is None]
        if sides.get(start) == "right":
            found |= dict.fromkeys(unknown, "RCA")
        elif sides.get(start) == "left" and unknown:
            right = next((ends for other, ends in starts.items() if sides.get(other) == "right"), None)
            left = _left_arteries(paths, start, own, known, root, right)
            found |= {end: left[end] for end in unknown}
    return found


def _ostium(paths: Paths, end: str, ends: Iterable[str]) -> str:
    """Return the first vessel on the way to an end that feeds coronary ends only."""
    return paths.own_vessels(end, frozenset(ends))[0].name


def _sides(tree: Tree, starts: dict[str, list[str]], known: dict[str, Branch | None]) -> dict[str, str]:
    """Return the side of every coronary tree, by its names, else by its first bifurcation.

    The left one divides early into two parts of which neither is short, LAD and LCx.
    """
    sides: dict[str, str] = {}
    for start, own in starts.items():
        words = [v.name for v in tree.subtree(start)]
        arteries = {known[end] for end in own} - {None}
        if arteries & {"LAD", "LCx"} or any(says(word, NAMED["left"]) for word in words):
            sides[start] = "left"
        elif arteries:
            sides[start] = "right"
    extent = {start: (_division(tree, start), len(own), _length(tree, start)) for start, own in starts.items()}
    for start in sorted(starts, key=lambda start: extent[start], reverse=True):
        missing = [side for side in ("left", "right") if side not in sides.values()]
        if start not in sides and missing:
            sides[start] = missing[0]
    return sides


def _division(tree: Tree, start: str) -> float:
    """Return the length of the lesser part behind the first bifurcation over the length of the trunk before it."""
    trunk = [tree[start]]
    while len(children := tree.children(trunk[-1].name)) == 1:
        trunk += children
    parts = sorted(_length(tree, child.name) for child in children)
    return parts[-2] / sum(v.length for v in trunk) if parts else 0.0


def _length(tree: Tree, name: str) -> float:
    """Return the length (cm) of a vessel and all downstream of it."""
    return sum(v.length for v in tree.subtree(name))


def _left_arteries(
    paths: Paths,
    start: str,
    ends: Sequence[str],
    known: dict[str, Branch | None],
    root: np.ndarray,
    right: Sequence[str] | None,
) -> dict[str, Branch]:
    """Return the artery of each end of a left tree: its two parts behind the first bifurcation are LAD and LCx.

    right: the ends of the right coronary artery, if there is one; root: the middle of the ostia.
    """
    tree = paths.tree
    trunk = start
    while len(children := tree.children(trunk)) == 1:
        trunk = children[0].name
    parts = {child.name: paths.ends(child.name) for child in children} or {trunk: list(ends)}
    arteries: dict[str, Branch] = {}
    for part, own in parts.items():
        named = Counter(branch for end in own if (branch := known[end]) is not None)
        if named:
            arteries[part] = named.most_common(1)[0][0]
    if right is None:
        away = {part: max(float(np.linalg.norm(tree[e].points[-1] - root)) for e in own) for part, own in parts.items()}
    else:
        groove = first_part(paths.course(paths.longest(right), right))
        away = {part: off_plane(np.vstack([groove, in_groove_with(paths, own, groove)])) for part, own in parts.items()}
    for part in sorted(parts, key=lambda part: -away[part]):
        arteries.setdefault(part, "LCx" if "LAD" in arteries.values() else "LAD")
    return {end: arteries[part] for part, own in parts.items() for end in own}


def _along_artery(
    paths: Paths, ends: Sequence[str], branch: Branch, courses: Courses | None, numbers: _Numbers
) -> dict[str, tuple[str, Tissue]]:
    """Return label and tissue of the ends of an artery: its own end, and side branches numbered along its course."""
    if not ends:
        return {}
    tree = paths.tree
    arc = {v.name: sum(part.length for part in tree.path(v.name)) for v in tree}
    named = next((end for end in ends if artery_label(end) == branch and end.isalpha()), None)
    main = named or (_main(paths, ends) if courses is None else _own_end(courses, branch, ends))
    path = [v.name for v in tree.path(main)]
    leaves_at = {end: next(v.name for v in reversed(tree.path(end)) if v.name in path) for end in ends}
    side: dict[tuple[str, str], list[str]] = {}
    for end in sorted((end for end in ends if end != main), key=lambda end: (arc[leaves_at[end]], end)):
        behind = tree.path(end)[path.index(leaves_at[end]) + 1].name
        side.setdefault((leaves_at[end], behind), []).append(end)
    first = min((arc[place] for place in leaves_at.values()), default=0.0)
    crux = first + CRUX * (arc[main] - first)
    labels: dict[str, tuple[str, Tissue]] = {}
    for (place, _), own in side.items():
        stems = {
            end: _stem_by_distance(branch, arc[place] >= crux)
            if courses is None
            else _stem_by_place(paths, end, place, branch, courses)
            for end in own
        }
        if branch == "RCA" and "PL" in stems.values():  # what leaves a posterolateral trunk is posterolateral
            stems = dict.fromkeys(own, "PL")
        stems |= {end: "S" for end in own if says(end, SEPTUM)}
        names = {end: _own_label(end) for end in own}
        for stem in dict.fromkeys(stems.values()):
            alike = [end for end in own if stems[end] == stem and names[end] is None]
            if stem == "PL":  # each has its own number, in the order in which they leave their trunk
                # The arc of the vessel before it is one number for both ends of a fork.
                alike.sort(key=lambda end: (arc[tree.path(end)[-2].name], end))
            number = ""
            for k, end in enumerate(alike):
                number = numbers.next(stem) if k == 0 or stem == "PL" else number
                names[end] = number + (chr(ord("a") + k) if k and stem != "PL" else "")
        for end, label in names.items():
            labels[end] = (label or end, tissue_of(end, None) or TISSUES.get(stems[end], "LV"))
    tissue: Tissue = "LV"
    if courses is None:
        posterior = branch == "RCA" and any(arc[place] >= crux for end, place in leaves_at.items() if end != main)
    else:
        posterior = main == courses.pda
        if branch == "RCA" and courses.pda is not None and not posterior:
            tissue = TISSUES.get(_stem_by_place(paths, main, main, branch, courses), "LV")
    return labels | {main: (_own_label(main) or ("PDA" if posterior else branch), tissue_of(main, None) or tissue)}


def _own_end(courses: Courses, branch: Branch, ends: Sequence[str]) -> str:
    """Return the end of an artery's own course by its place on the heart: that of the dominant artery is the PDA."""
    if courses.pda is not None and courses.pda in ends:
        return courses.pda
    return {"LAD": courses.lad, "LCx": courses.circumflex, "RCA": courses.right}[branch]


def _stem_by_distance(branch: Branch, beyond_crux: bool) -> str:
    """Return the kind of a side branch where the places of the other arteries are unknown."""
    return "PL" if branch == "RCA" and beyond_crux else LIKELY[branch]


def _stem_by_place(paths: Paths, end: str, place: str, branch: Branch, courses: Courses) -> str:
    """Return the kind of a side branch, without number, by where it leads from the vessel `place` of its artery.

    Of the LAD, a diagonal runs over the left ventricle, a septal branch into the heart, others over the right one. Of
    the circumflex, a branch on the inferior wall is a posterolateral one. Of the right coronary artery, one on the
    left ventricle's side of the PDA is.
    """
    frame, point = courses.frame, paths.tree[end].points[-1]
    if branch == "LAD":
        leftwards, inwards = departure(paths, place, paths.behind(place, end), frame)
        return "D" if leftwards >= inwards else "RV" if -leftwards > inwards else "S"
    if branch == "LCx":
        return "PL" if is_inferior(paths, end, courses) else "OM"
    groove = 0.0 if courses.pda is None else float(frame.aside(apical_middle(paths, courses.pda, frame)))
    behind = float((point - frame.centre) @ frame.anterior) < 0
    return "PL" if behind and float(frame.aside(point)) > groove else "RV"


def _main(paths: Paths, ends: Sequence[str]) -> str:
    """Return the end of an artery's own course, along the vessels that feed most of `ends`, then the wider ones."""
    tree, own, ways = paths.tree, set(ends), [paths.tree.path(end) for end in ends]
    at = ways[0][max(k for k in range(min(map(len, ways))) if len({way[k].name for way in ways}) == 1)]
    while at.name not in own:
        fed = {v.name: len(own.intersection(paths.ends(v.name))) for v in tree.children(at.name)}
        onward = [v for v in tree.children(at.name) if fed[v.name]]
        at = max(onward, key=lambda v: (fed[v.name], float(np.median(v.radii)), v.name))
    return at.name


def artery_label(name: str) -> Branch | None:
    """Return the artery whose own name, perhaps with a number, a vessel has."""
    known: dict[Branch, str] = {"LAD": r"lad\d*", "LCx": r"l?cx\d*", "RCA": r"rca\d*"}
    return next((branch for branch, pattern in known.items() if says(name, pattern)), None)


def _own_label(name: str) -> str | None:
    """Return a vessel's name if it is a label that a reader knows, such as D1, and not a number of many (rca7)."""
    if re.fullmatch(r"(lad|l?cx|rca)\d*", name.lower()):
        return artery_label(name) if name.isalpha() else None
    known = [NAMED[key] for key in (*BRANCHES, "distal")]
    return name if any(re.fullmatch(pattern, name.lower()) for pattern in known) else None
