"""An aorta for coronary trees without one, which the 0D loop needs; only the domain `whole` meshes it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel
from coronaryuq.core.errors import InputError

RADIUS = 1.3
"""cm, of an adult's ascending aorta (Hager et al. 2002)."""
WIDEST = 4.0
"""cm: radius beyond which no aorta reaches from one ostium to another."""
LENGTHS = (2.0, 4.0)
"""cm, from the valve to the first ostium and from the last one on."""
NAMES = ("aorta", "aorta_outlet")
APART = 0.05
"""cm along the aorta below which two arteries leave it at one place."""
CORONARY = 0.6
"""cm: largest median radius of a coronary artery, aneurysms included; a wider root is an aorta."""


def is_aorta(vessel: Vessel) -> bool:
    """Return whether a vessel is too wide for a coronary artery."""
    return float(np.median(vessel.radii)) > CORONARY


def with_aorta(trees: Sequence[Tree]) -> Tree:
    """Return coronary trees attached to the side of one straight aorta, with their former roots on its wall.

    Like every ostial vessel, these roots then start on the aortic axis, so their arc length grows by the aorta's
    radius. That is `RADIUS`, or more if the ostia of two trees are farther apart than such an aorta is wide.

    Raises
    ------
    ValueError
        If the ostia are too far apart for an aorta, or two trees have a vessel of the same name.
    """
    roots = [tree.root for tree in trees]
    ostia = np.array([root.points[0] for root in roots])
    outwards = np.array([root.tangent_at(0.0) for root in roots])
    axis, centre, radius = _axis(ostia, outwards)
    if radius > WIDEST:
        names = " and ".join(root.name for root in roots)
        raise ValueError(f"{names} begin {2 * radius:.3g} cm apart, too far for one aorta; are they in one frame?")
    along = (ostia - centre) @ axis
    places = [along.min()]
    for place in np.sort(along):
        if place - places[-1] > APART:
            places.append(place)
    ends = [*places, places[-1] + LENGTHS[1]]
    begin, taken = places[0] - LENGTHS[0], {vessel.name for tree in trees for vessel in tree}
    vessels: list[Vessel] = []
    for k, end in enumerate(ends):
        name = NAMES[1] if k == len(ends) - 1 else NAMES[0] if k == 0 else f"{NAMES[0]}_{k + 1}"
        while name in taken:
            name += "_"
        taken.add(name)
        points = centre + np.linspace(begin, end, 21)[:, None] * axis
        parent = vessels[-1].name if vessels else None
        vessels.append(Vessel(name, points, np.full(21, radius), parent, AORTA, made=True))
        begin = end
    for tree, root, place in zip(trees, roots, along, strict=True):
        stem = vessels[int(np.argmin(np.abs(np.array(places) - place)))]
        points, radii = np.vstack([stem.points[-1], root.points]), np.r_[root.radii[0], root.radii]
        vessels.append(replace(root, points=points, radii=radii, parent=stem.name))
        vessels += [vessel for vessel in tree if vessel is not root]
    return Tree(vessels)


def one_tree(file: str | Path, trees: Sequence[Tree], notes: list[str]) -> Tree:
    """Return a single tree as it is, and several joined by an aorta, of which a note is added.

    Raises
    ------
    InputError
        If the ostia are too far apart.
    """
    if len(trees) == 1:
        return trees[0]
    try:
        tree = with_aorta(trees)
    except ValueError as error:
        raise InputError(file, "anatomy", None, str(error)) from None
    notes.append(note_of(tree, trees))
    return tree


def note_of(tree: Tree, trees: Sequence[Tree]) -> str:
    """Return the note on an added aorta."""
    several = f", from which {len(trees)} separate trees arise ({', '.join(t.root.name for t in trees)})"
    return (
        f"anatomy: has no aorta; added one of radius {tree.root.radii[0]:.3g} cm for the 0D loop"
        f"{several if len(trees) > 1 else ''}"
    )


def _axis(ostia: np.ndarray, outwards: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the direction of an aorta, a point of its axis, and its radius, so that the ostia lie on its wall.

    The arteries leave it as perpendicularly as they can; of the directions that are as good, it takes that in which
    the ostia are apart.
    """
    spread = ostia - ostia.mean(axis=0)
    spread = spread / max(float(np.linalg.norm(spread, axis=1).max()), 1e-9)
    _, vectors = np.linalg.eigh(outwards.T @ outwards - 0.01 * spread.T @ spread)
    axis = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
    flat = ostia - np.outer(ostia @ axis, axis)
    away = outwards - np.outer(outwards @ axis, axis)
    mean = away.sum(axis=0)
    if len(ostia) == 2:
        between = flat[1] - flat[0]
        half = 0.5 * float(np.linalg.norm(between))
        across = np.cross(axis, between) if half > 1e-9 else mean
        across = across / max(float(np.linalg.norm(across)), 1e-9) * (-1.0 if across @ mean < 0 else 1.0)
        radius = max(RADIUS, half)
        centre = flat.mean(axis=0) - np.sqrt(radius**2 - half**2) * across
    else:
        unit = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        centre = (flat - RADIUS * unit).mean(axis=0)
        radius = float(np.linalg.norm(flat - centre, axis=1).mean())
    return axis, centre, radius
