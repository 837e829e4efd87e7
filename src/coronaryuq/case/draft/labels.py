"""Artery, label and tissue of every coronary end: from the names in the files, else from the course of the vessels."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel
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
CRUX = 0.5
"""Fraction of the length of the right coronary artery beyond which its branches perfuse the left ventricle."""

SPACING = 0.1
"""cm between the points of a course."""


@dataclass(frozen=True)
class EndLabel:
    """What an end of the tree is: artery and tissue (None: unknown), its usual label, whether its name says so."""

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
    by_place = _by_place(tree, ends, {end: branch for end, (branch, _) in branches.items()})
    branches |= {end: (branch, False) for end, branch in by_place.items()}
    labels: dict[str, EndLabel] = {}
    for branch in BRANCHES:
        own = [end for end in ends if branches[end][0] == branch]
        for end, (label, perfuses) in _along_artery(tree, own, branch).items():
            labels[end] = EndLabel(branch, label, perfuses, branches[end][1])
    return {end: labels.get(end) or EndLabel(None, end, None, False) for end in ends}


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


def _by_place(tree: Tree, ends: Sequence[str], known: dict[str, Branch | None]) -> dict[str, Branch]:
    """Return the artery of the ends of which no name tells it."""
    starts: dict[str, list[str]] = {}
    for end in ends:
        starts.setdefault(_ostium(tree, end, ends), []).append(end)
    sides = _sides(tree, starts, known)
    root = np.mean([tree[start].points[0] for start in starts], axis=0)
    found: dict[str, Branch] = {}
    for start, own in starts.items():
        unknown = [end for end in own if known[end] is None]
        if sides.get(start) == "right":
            found |= dict.fromkeys(unknown, "RCA")
        elif sides.get(start) == "left" and unknown:
            right = next((_course(tree, ends) for other, ends in starts.items() if sides.get(other) == "right"), None)
            left = _left_arteries(tree, start, own, known, root, right)
            found |= {end: left[end] for end in unknown}
    return found


def _ostium(tree: Tree, end: str, ends: Iterable[str]) -> str:
    """Return the first vessel on the way to an end that feeds coronary ends only."""
    coronary = set(ends)
    return next(v.name for v in tree.path(end) if {w.name for w in _leaves(tree, v.name)} <= coronary)


def _leaves(tree: Tree, name: str) -> list[Vessel]:
    return [v for v in tree.subtree(name) if not tree.children(v.name)]


def _sides(tree: Tree, starts: dict[str, list[str]], known: dict[str, Branch | None]) -> dict[str, str]:
    """Return the side of every coronary tree, by its names, else by the number of its ends and its length."""
    sides: dict[str, str] = {}
    for start, own in starts.items():
        words = [v.name for v in tree.subtree(start)]
        arteries = {known[end] for end in own} - {None}
        if arteries & {"LAD", "LCx"} or any(says(word, NAMED["left"]) for word in words):
            sides[start] = "left"
        elif arteries:
            sides[start] = "right"
    extent = {start: (len(own), sum(v.length for v in tree.subtree(start))) for start, own in starts.items()}
    for start in sorted(starts, key=lambda start: extent[start], reverse=True):
        missing = [side for side in ("left", "right") if side not in sides.values()]
        if start not in sides and missing:
            sides[start] = missing[0]
    return sides


def _left_arteries(
    tree: Tree,
    start: str,
    ends: Sequence[str],
    known: dict[str, Branch | None],
    root: np.ndarray,
    right: np.ndarray | None,
) -> dict[str, Branch]:
    """Return the artery of each end of a left tree: its two parts behind the first bifurcation are LAD and LCx.

    right: the course (n, 3) of the right coronary artery, if there is one; root: the middle of the ostia.
    """
    trunk = start
    while len(children := tree.children(trunk)) == 1:
        trunk = children[0].name
    parts = {child.name: [v.name for v in _leaves(tree, child.name)] for child in children} or {trunk: list(ends)}
    arteries: dict[str, Branch] = {}
    for part, own in parts.items():
        named = Counter(branch for end in own if (branch := known[end]) is not None)
        if named:
            arteries[part] = named.most_common(1)[0][0]
    if right is None:
        away = {part: max(float(np.linalg.norm(tree[e].points[-1] - root)) for e in own) for part, own in parts.items()}
    else:
        away = {part: _off_plane(np.vstack([right, _course(tree, own)])) for part, own in parts.items()}
    for part in sorted(parts, key=lambda part: -away[part]):
        arteries.setdefault(part, "LCx" if "LAD" in arteries.values() else "LAD")
    return {end: arteries[part] for part, own in parts.items() for end in own}


def _course(tree: Tree, ends: Sequence[str]) -> np.ndarray:
    """Return the first part, up to `CRUX`, of an artery's own course as points (n, 3), evenly spaced."""
    path = [v for v in tree.path(_main(tree, ends)) if {leaf.name for leaf in _leaves(tree, v.name)} <= {*ends}]
    points = np.concatenate([v.resampled(SPACING).points for v in path])
    return points[: max(3, int(CRUX * len(points)))]


def _off_plane(points: np.ndarray) -> float:
    """Return the root mean square distance of points (n, 3) from their plane."""
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points)))


def _along_artery(tree: Tree, ends: Sequence[str], branch: Branch) -> dict[str, tuple[str, Tissue]]:
    """Return label and tissue of the ends of an artery: its own end, and side branches numbered along its course."""
    if not ends:
        return {}
    arc = {v.name: sum(part.length for part in tree.path(v.name)) for v in tree}
    main = next((end for end in ends if artery_label(end) == branch and end.isalpha()), None) or _main(tree, ends)
    course = [v.name for v in tree.path(main)]
    leaves_at = {end: next(v.name for v in reversed(tree.path(end)) if v.name in course) for end in ends}
    first = min((arc[place] for place in leaves_at.values()), default=0.0)
    distal = first + CRUX * (arc[main] - first)
    labels: dict[str, tuple[str, Tissue]] = {}
    numbers: Counter[str] = Counter()
    side: dict[tuple[str, str], list[str]] = {}
    for end in sorted((end for end in ends if end != main), key=lambda end: (arc[leaves_at[end]], end)):
        behind = tree.path(end)[course.index(leaves_at[end]) + 1].name
        side.setdefault((leaves_at[end], behind), []).append(end)
    crossed = any(arc[place] >= distal for end, place in leaves_at.items() if end != main)
    for (place, _), own in side.items():
        stem = "PL" if branch == "RCA" and arc[place] >= distal else LIKELY[branch]
        stem = "S" if all(says(end, SEPTUM) for end in own) else stem
        numbers[stem] += 1
        for k, end in enumerate(own):
            label = f"{stem}{numbers[stem]}{chr(ord('a') + k) if len(own) > 1 and k else ''}"
            labels[end] = (_own_label(end) or label, tissue_of(end, branch) or ("RV" if stem == "RV" else "LV"))
    label = "PDA" if branch == "RCA" and crossed else branch
    return labels | {main: (_own_label(main) or label, tissue_of(main, branch) or "LV")}


def _main(tree: Tree, ends: Sequence[str]) -> str:
    """Return the end of an artery's own course, along the vessels that feed most of `ends`, then the wider ones."""
    own, paths = set(ends), [tree.path(end) for end in ends]
    at = paths[0][max(k for k in range(min(map(len, paths))) if len({path[k].name for path in paths}) == 1)]
    while at.name not in own:
        fed = {v.name: len(own & {leaf.name for leaf in _leaves(tree, v.name)}) for v in tree.children(at.name)}
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
