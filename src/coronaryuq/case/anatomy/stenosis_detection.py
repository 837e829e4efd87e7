"""Stenosis detection: narrowings relative to the healthy calibre interpolated from both sides."""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import count

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, area_ratio
from coronaryuq.case.anatomy.vessel_names import course, natural_key
from coronaryuq.case.description.fields import ARTERIES

REACH = (0.3, 0.5, 0.75, 1.0, 1.5)
"""cm on either side within which the healthy calibre is sought."""
SHORTEST = 0.2
"""cm: minimum length of a stenosis."""
SMALLEST = 0.075
"""cm: smallest healthy radius of a stenosis; trials treat vessels of 1.5 mm diameter and more (SYNTAX)."""


def relative_area(vessel: Vessel, first: float, spacing: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Return arc lengths (n,) cm from `first` on, and the area over the healthy area there, at most 1.

    The healthy radius is interpolated between the largest radii within reach upstream and downstream: a taper or a step
    at a side branch is not a narrowing, a waist between two wider sections is. The smallest ratio over all `REACH`
    counts.
    """
    arc = np.linspace(first, vessel.length, max(3, int((vessel.length - first) / spacing) + 1))
    radius = vessel.radius_at(arc)
    ratio = np.ones(len(arc))
    for reach in REACH:
        for k, here in enumerate(arc):
            up, down = (arc >= here - reach) & (arc <= here), (arc >= here) & (arc <= here + reach)
            i, j = np.flatnonzero(up)[np.argmax(radius[up])], np.flatnonzero(down)[np.argmax(radius[down])]
            if i < k < j:
                healthy = np.interp(here, [arc[i], arc[j]], [radius[i], radius[j]])
                ratio[k] = min(ratio[k], (radius[k] / healthy) ** 2)
    return arc, ratio


def stenosis_at(tree: Tree, name: str, vessel: str, arc: float, length: float | None = None) -> Stenosis:
    """Return the stenosis of artery `name` at arc length `arc`: of this length, or from shoulder to shoulder."""
    first, last = tree.emergence(vessel), tree[vessel].length
    if length is not None:
        start = min(max(arc - length / 2, first), max(first, last - length))
        return Stenosis(name, vessel, start, min(start + length, last))
    arcs, _ = relative_area(tree[vessel], first)
    radius = tree[vessel].radius_at(arcs)
    near = np.abs(arcs - arc) <= 0.3
    throat = np.flatnonzero(near)[np.argmin(radius[near])] if near.any() else int(np.argmin(np.abs(arcs - arc)))
    start, end = _shoulders(arcs, radius, throat)
    return Stenosis(name, vessel, start, end)


def detected_stenoses(tree: Tree, below: float, serial: float, labels: Mapping[str, str]) -> list[Stenosis]:
    """Return the narrowest stenosis of each of LAD, LCx and RCA, and all others that are narrower still.

    They are in the order of the arteries and, in each, of the distance from its ostium. The first of an artery has the
    artery's name, or that of the side branch in which it lies; those after it have numbers from 2 on.

    Parameters
    ----------
    tree
        Vessels, cm.
    below
        Area ratio below which the narrowest counts.
    serial
        Area ratio below which others, and stenoses of the left main, count.
    labels
        Vessel that ends in an outlet → label of the outlet.
    """
    stenoses = []
    for branch in ARTERIES:
        found = [part for vessel in tree if vessel.branch == branch for part in _narrowings(tree, vessel, below)]
        found.sort(key=lambda part: part[0])
        for number, (ratio, vessel_name, start, end) in enumerate(found):
            if ratio < serial or (number == 0 and branch != "LM"):
                stenoses.append(Stenosis(branch, vessel_name, start, end))
    return _named(tree, sorted(stenoses, key=lambda s: _place_in_order(tree, s)), labels)


def _place_in_order(tree: Tree, stenosis: Stenosis) -> tuple[int, float]:
    before = sum(vessel.length for vessel in tree.path(stenosis.vessel)[:-1])
    return ARTERIES.index(stenosis.name), before + stenosis.start


def _named(tree: Tree, stenoses: list[Stenosis], labels: Mapping[str, str]) -> list[Stenosis]:
    """Return the stenoses, each with a name of its own: artery or side branch, with a number from 2 on."""
    main = {vessel.name for artery in ARTERIES for vessel in course(tree, artery, labels)}
    names: list[str] = []
    for stenosis in stenoses:
        vessel = tree[stenosis.vessel]
        fed = sorted((labels[v.name] for v in tree.subtree(vessel.name) if v.name in labels), key=natural_key)
        own = vessel.branch if vessel.name in main or not fed else fed[0]
        own = own if re.fullmatch(r"[A-Za-z][A-Za-z0-9]{0,12}", own) else vessel.branch
        number = "x" if own[-1].isdigit() else ""
        tried = (own if k == 1 else f"{own}{number}{k}" for k in count(1))
        names.append(next(name for name in tried if name.lower() not in [other.lower() for other in names]))
    return [replace(stenosis, name=name) for stenosis, name in zip(stenoses, names, strict=True)]


def _narrowings(tree: Tree, vessel: Vessel, below: float) -> list[tuple[float, str, float, float]]:
    """Return area ratio, vessel, start and end of the narrowings of a vessel, the narrowest first; none overlap."""
    first = tree.emergence(vessel.name)
    found: list[tuple[float, str, float, float]] = []
    if vessel.length - first < 2 * SHORTEST:
        return []
    arc, ratio = relative_area(vessel, first)
    ratio = np.where(vessel.radius_at(arc) / np.sqrt(ratio) < SMALLEST, np.inf, ratio)
    while ratio.min() < below:
        k = int(np.argmin(ratio))
        start, end = _shoulders(arc, vessel.radius_at(arc), k)
        apart = all(end <= other_start or start >= other_end for _, _, other_start, other_end in found)
        exact = area_ratio(tree, Stenosis(vessel.branch, vessel.name, start, end))
        if apart and exact < below:
            found.append((float(ratio[k]), vessel.name, start, end))
        ratio = np.where((arc >= start) & (arc <= end), np.inf, ratio)
        ratio[k] = np.inf
    return found


def example_stenosis(tree: Tree) -> str:
    """Return an entry of `stenoses` in `case.yaml` for this tree: up to 1 cm in the middle of its longest vessel."""
    arteries = [vessel for vessel in tree if vessel.branch in ("LAD", "LCx", "RCA")]
    if not arteries:
        return "{name: LAD, vessel: LAD, start: 2.0, end: 3.0}"
    vessel = max(arteries, key=lambda artery: artery.length - tree.emergence(artery.name))
    first = tree.emergence(vessel.name)
    middle, half = (first + vessel.length) / 2, min(1.0, (vessel.length - first) / 2) / 2
    return f"{{name: {vessel.branch}, vessel: {vessel.name}, start: {middle - half:.2f}, end: {middle + half:.2f}}}"


def _shoulders(arc: np.ndarray, radius: np.ndarray, throat: int) -> tuple[float, float]:
    """Return the arc lengths where the calibre stops growing on either side, at least `SHORTEST` apart."""
    i = j = throat
    step = arc[1] - arc[0]
    window = max(1, int(round(0.1 / step)))
    while i > 0 and radius[max(i - window, 0)] > radius[i] * 1.005 and arc[throat] - arc[i] < max(REACH):
        i -= 1
    last = len(arc) - 1
    while j < last and radius[min(j + window, last)] > radius[j] * 1.005 and arc[j] - arc[throat] < max(REACH):
        j += 1
    start, end = float(arc[i]), float(arc[j])
    if end - start < SHORTEST:
        start, end = max(arc[0], arc[throat] - SHORTEST / 2), min(arc[-1], arc[throat] + SHORTEST / 2)
    return float(start), float(end)
