"""SimVascular projects: paths (.pth) and contour groups (.ctgr) become a centreline tree."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq.case.tree import Tree, Vessel, project
from coronaryuq.errors import InputError

LARGEST = 200_000_000
"""Bytes of one file."""
SPACING = 0.05
"""cm between centreline points."""
ATTACH = 1.5
"""A path branches off another if it starts within this many radii of it."""


@dataclass(frozen=True)
class Contoured:
    """One path with its contours: name, points (n, 3) and radii (n,) of discs of the contours' areas, in file units."""

    name: str
    points: np.ndarray
    radii: np.ndarray


def read_project(folder: str | Path, scale: float) -> Tree:
    """The tree of a project with Paths/*.pth and Segmentations/*.ctgr; `scale` is its length unit in cm.

    Every path that has contours becomes a vessel, from its first control point on; it starts on the path nearest there.
    Raises InputError for a missing folder, a broken file and a path that touches no other.
    """
    folder = Path(folder)
    paths, groups = sorted((folder / "Paths").glob("*.pth")), sorted((folder / "Segmentations").glob("*.ctgr"))
    if not paths or not groups:
        raise InputError(folder, None, None, "wanted Paths/*.pth and Segmentations/*.ctgr")
    contoured = [_contoured(path, {g.stem: g for g in groups}) for path in paths]
    lines = [
        Vessel(c.name, c.points * scale, c.radii * scale).resampled(SPACING) for c in contoured if c is not None
    ]  # fmt: skip
    if not lines:
        raise InputError(folder, "Segmentations", None, "no path has a contour group of its name with two contours")
    return joined(folder, lines)


def joined(folder: Path, lines: list[Vessel]) -> Tree:
    """One tree of overlapping lines: each starts at its nearest place on another, which is cut there.

    The root is the line that leaves the others nearest to where they start.
    """
    attempts = [_attached(first, lines) for first in lines]
    reached, place, worst, (line, other) = min(attempts, key=lambda attempt: attempt[2])
    if worst > ATTACH:
        raise InputError(
            folder, line, None, f"starts {worst:.1f} radii off the nearest vessel, {other}; wanted at most {ATTACH}"
        )
    return _cut(reached, place)


def _attached(first: Vessel, lines: list[Vessel]) -> tuple[list[Vessel], dict[str, tuple[str, float]], float, tuple]:
    """Lines in the order in which they join, nearest first, where each does, and how far off the worst one was."""
    reached, left = [first], [v for v in lines if v is not first]
    place: dict[str, tuple[str, float]] = {}
    worst, who = 0.0, ("", "")
    while left:
        options = []
        for line in left:
            for other in reached:
                arc, distance = project(other, line.points[0])
                options.append((distance / float(other.radius_at(arc)), line, other, arc))
        relative, line, other, arc = min(options, key=lambda option: option[0])
        if relative > worst:
            worst, who = relative, (line.name, other.name)
        place[line.name] = (other.name, arc)
        reached.append(line)
        left = [v for v in left if v is not line]
    return reached, place, worst, who


def _cut(lines: list[Vessel], place: dict[str, tuple[str, float]]) -> Tree:
    """Vessels between bifurcations: the last part of a line keeps its name, earlier ones add _1, _2, ..."""
    vessels: list[Vessel] = []
    piece_at: dict[str, list[tuple[float, str]]] = {}
    for line in lines:
        least = 0.5 * float(np.median(line.radii))
        arcs = sorted(arc for other, arc in place.values() if other == line.name)
        cuts: list[float] = []
        for arc in arcs:
            arc = min(max(arc, least), line.length - least)
            if not cuts or arc - cuts[-1] > least:
                cuts.append(arc)
        ends = [*cuts, line.length]
        names = [f"{line.name}_{k + 1}" for k in range(len(cuts))] + [line.name]
        parent = None
        start_point = None
        if line.name in place:
            other, arc = place[line.name]
            parent = min(piece_at[other], key=lambda entry: abs(entry[0] - arc))[1]
            start_point = next(v for v in vessels if v.name == parent).points[-1]
        begin = 0.0
        for name, end in zip(names, ends, strict=True):
            part = line.between(begin, end)
            points, radii = part.points, part.radii
            if start_point is not None and np.linalg.norm(points[0] - start_point) > 1e-9:
                points, radii = np.vstack([start_point, points]), np.concatenate([radii[:1], radii])
            vessels.append(Vessel(name, points, radii, parent))
            parent, start_point, begin = name, None, end
        piece_at[line.name] = list(zip(cuts, names[:-1], strict=True))
    return Tree(vessels)


def _contoured(path: Path, groups: dict[str, Path]) -> Contoured | None:
    """A path's contours in order: centre and radius of each; None for a path without two contours."""
    root = _xml(path)
    control = _points(path, root, ".//control_points/point")
    if len(control) < 2:
        raise InputError(path, "control_points", len(control), "wanted two or more points")
    if path.stem not in groups:
        return None
    centres, radii = [], []
    for contour in _xml(groups[path.stem]).iter("contour"):
        rim = _points(groups[path.stem], contour, "contour_points/point")
        if len(rim) < 3:
            continue
        centre = rim.mean(axis=0)
        area = 0.5 * np.linalg.norm(np.cross(rim - centre, np.roll(rim, -1, axis=0) - centre).sum(axis=0))
        centres.append(centre)
        radii.append(np.sqrt(area / np.pi))
    if len(centres) < 2:
        return None
    # Contours begin where the artery is free of its parent: the path's own points lead there from its origin.
    along = centres[1] - centres[0]
    lead = control[: np.argmin(np.linalg.norm(control - centres[0], axis=1)) + 1]
    lead = lead[(lead - centres[0]) @ along < -1e-6 * float(along @ along)]
    return Contoured(path.stem, np.vstack([lead, centres]), np.concatenate([np.full(len(lead), radii[0]), radii]))


def _xml(path: Path) -> ElementTree.Element:
    if path.stat().st_size > LARGEST:
        raise InputError(path, None, f"{path.stat().st_size} bytes", f"more than {LARGEST}")
    text = path.read_text(encoding="utf-8", errors="replace")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, None, None, "holds a document type definition, which SimVascular does not write")
    # SimVascular writes a `format` element before the root: two roots, which XML does not allow.
    body = text[text.index("?>") + 2 :] if text.lstrip().startswith("<?xml") and "?>" in text else text
    try:
        return ElementTree.fromstring(f"<file>{body}</file>")
    except ElementTree.ParseError as error:
        raise InputError(path, None, None, f"not valid XML ({error})") from None


def _points(path: Path, element: ElementTree.Element, where: str) -> np.ndarray:
    try:
        points = np.array([[float(p.attrib[k]) for k in "xyz"] for p in element.findall(where)], dtype=float)
    except (KeyError, ValueError) as error:
        raise InputError(path, where, None, f"a point without proper x, y and z ({error})") from None
    if not np.isfinite(points).all():
        raise InputError(path, where, None, "a point that is not finite")
    return points.reshape(-1, 3)
