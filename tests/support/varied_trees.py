"""Synthetic patients whose coronary trees differ in more than degrees: other branchings, places, lengths, dominance."""

from collections import Counter
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Tree
from coronaryuq.synthetic.anatomy import Anatomy, patient_anatomy
from coronaryuq.synthetic.arteries import PATTERNS, Artery, Pattern

MISSING = 0.35
"""Probability that a side branch is not there, or not seen."""
KINDS = {"conus": "RV", "AM": "RV"}
"""Kind of a side branch whose name is not its kind and number."""
INFERIOR = 122.0 - 0.75 * (122.0 - 243.0 + 360.0)
"""Degrees (φ): a branch of the circumflex that ends beyond is a posterolateral one, on the last of the four segments of
the free wall, which runs from the anterior groove (122) over lateral (0) to the posterior one (243 - 360)."""


def anonymous(tree: Tree) -> tuple[Tree, dict[str, str]]:
    """The tree with vessels called v0, v1, ... and no branches, and the new names."""
    new = {v.name: f"v{k}" for k, v in enumerate(tree)}
    vessels = [replace(v, name=new[v.name], parent=new.get(v.parent), branch=AORTA) for v in tree]
    return Tree(vessels), new


@dataclass(frozen=True)
class Varied:
    """An anatomy, the true label of every outlet's vessel, without letters, and its dominance as far as it shows."""

    anatomy: Anatomy
    labels: dict[str, str]
    dominance: str


def varied_anatomy(seed: int, dominance: str) -> Varied:
    """An anatomy drawn from a seed and a dominance: right, left or co.

    Where both arteries share the inferior wall but no posterolateral branch is there, none can tell it from `right`.
    """
    pattern = varied_pattern(np.random.default_rng([seed, 41]), dominance)
    with patch.dict(PATTERNS, varied=pattern):
        anatomy = patient_anatomy(seed, "varied", ())
    labels = true_labels(anatomy, pattern.arteries, dominance)
    shared = any(label.startswith("PL") for label in labels.values())
    return Varied(anatomy, labels, dominance if dominance != "co" or shared else "right")


def true_labels(anatomy: Anatomy, arteries: tuple[Artery, ...], dominance: str) -> dict[str, str]:
    """Label by vessel: kind and number in the order of leaving; parts of one side branch share its number."""
    place = {a.name: (a.origin, a.origin_point) for a in arteries}
    labels: dict[str, str] = {}
    numbers: Counter[str] = Counter()
    for artery in sorted(arteries, key=lambda a: (a.name == "PL", a.origin_point)):
        name, origin = artery.name, artery.origin
        if name in ("LAD", "LCx", "RCA", "PDA"):
            labels[name] = "PDA" if name == "LCx" and dominance == "left" else name
        elif origin in place and origin in ("LAD", "LCx", "RCA", "PDA", "PL"):
            kind = KINDS.get(name, name.rstrip("0123456789"))
            if origin == "LCx":
                kind = "PL" if artery.course[-1][0] < INFERIOR else "OM"
            numbers[kind] += 1
            labels[name] = f"{kind}{numbers[kind]}"
    for artery in arteries:
        labels.setdefault(artery.name, labels.get(artery.origin, ""))
    return {outlet.vessel: labels[outlet.label] for outlet in anatomy.outlets}


def varied_pattern(random: np.random.Generator, dominance: str) -> Pattern:
    """A pattern of arteries with side branches left out and moved, and main courses shifted and shortened."""
    base = PATTERNS["right" if dominance == "co" else dominance]
    arteries = _codominant() if dominance == "co" else base.arteries
    moved: dict[str, Artery] = {}
    for artery in arteries:
        main = artery.name in ("LAD", "LCx", base.right)
        if not main and (artery.origin not in moved or random.random() < MISSING):
            continue
        phi, s, depth = np.array(artery.course).T
        phi = phi + random.normal(0, 3 if main else 5)
        s = np.where(s > 0.1, s * random.normal(1, 0.06), s + random.normal(0, 0.01))
        point = artery.origin_point
        if not main:
            origin = moved[artery.origin]
            point = float(np.clip(point + random.normal(0, 0.25), 0.3, len(origin.course) - 1.3))
            before, after = (_at(origin.course, index) for index in (artery.origin_point, point))
            phi, s = phi + after[0] - before[0], s + after[1] - before[1]
        course = tuple(zip(phi.tolist(), s.tolist(), depth.tolist(), strict=True))
        moved[artery.name] = replace(artery, course=course, origin_point=point)
    lad = moved["LAD"]
    last = max([a.origin_point for a in moved.values() if a.origin == "LAD"], default=3.0)
    keep = max(len(lad.course) - int(random.integers(0, 3)), int(np.ceil(last)) + 2)
    moved["LAD"] = replace(lad, course=lad.course[:keep])
    return replace(base, arteries=tuple(moved.values()))


def _at(course, index: float) -> np.ndarray:
    return np.array([np.interp(index, range(len(course)), values) for values in np.array(course).T])


def _codominant() -> tuple[Artery, ...]:
    """The right artery ends as PDA without posterolateral branches; the circumflex reaches them, but not the PDA."""
    left = {a.name: a for a in PATTERNS["left"].arteries}
    right = {a.name: a for a in PATTERNS["right"].arteries}
    circumflex = replace(left["LCx"], course=left["LCx"].course[:10])
    second = replace(left["PL2"], origin_point=8.5)
    kept = [a for a in right.values() if not a.name.startswith("PL") and a.name != "LCx"]
    return (kept[0], circumflex, *kept[1:], left["PL1"], second)
