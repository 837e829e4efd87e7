"""SimVascular projects: paths (.pth) and contour groups (.ctgr) become a centreline tree."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

from coronaryuq.case.anatomy.tree import Tree, Vessel, project
from coronaryuq.core.errors import InputError

LARGEST = 200_000_000
"""Maximum size of one file, bytes."""
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


def read_project(folder: str | Path, scale: float) -> tuple[Tree, tuple[str, ...]]:
    """Read the tree of a project with Paths/*.pth and Segmentations/*.ctgr; `scale` is its length unit in cm.

    Also returns notes. Every path that has contours becomes a vessel, from its first control point on; it starts on the
    path nearest there. Raises InputError for a missing folder, a broken file and a path that touches no other.
    """
    folder = Path(folder)
    paths, groups = sorted((folder / "Paths").glob("*.pth")), sorted((folder / "Segmentations").glob("*.ctgr"))
    if not paths or not groups:
        raise InputError(folder, None, None, "expected Paths/*.pth and Segmentations/*.ctgr")
    of_path = {_path_name(group): group for group in groups} | {group.stem: group for group in groups}
    contoured = {path.stem: _contoured(path, of_path) for path in paths}
    left_out = [name for name, contours in contoured.items() if contours is None]
    lines = [_line(c.name, c.points * scale, c.radii * scale) for c in contoured.values() if c is not None]
    if not lines:
        raise InputError(
            folder, "Segmentations", None, "no path has a contour group of the same name with two or more contours"
        )
    notes = (f"left out paths with fewer than two contours: {', '.join(left_out)}",) if left_out else ()
    return join_lines(folder, lines, notes), notes


def _line(name: str, points: np.ndarray, radii: np.ndarray) -> Vessel:
    """Interpolate contour centres (modified Akima splines, which overshoot little) and radii (monotone cubics)."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    kept = np.concatenate([[True], np.diff(arc) > 0.0])
    arc, points, radii = arc[kept], points[kept], radii[kept]
    fine = np.linspace(0.0, arc[-1], max(2, int(np.ceil(arc[-1] / (0.25 * SPACING))) + 1))
    course = Akima1DInterpolator(arc, points, axis=0, method="makima")(fine)
    return Vessel(name, course, PchipInterpolator(arc, radii)(fine)).resampled(SPACING)


def _path_name(group: Path) -> str:
    """Return the name of the path that a contour group belongs to, by default the file's own name."""
    root = _xml(group).find("contourgroup")
    return group.stem if root is None else root.get("path_name", group.stem)


def join_lines(folder: Path, lines: list[Vessel], notes: tuple[str, ...] = ()) -> Tree:
    """Join lines to a tree: each starts at the nearest point of another line, which is cut there.

    The root is the line for which the others start closest to their parents. notes: appended to an error.
    """
    attempts = [_attached(first, lines) for first in lines]
    reached, origins, worst, (line, other) = min(attempts, key=lambda attempt: attempt[2])
    if worst > ATTACH:
        remedy = (
            f"path starts {worst:.1f} radii from {other}, the nearest; expected at most {ATTACH} (paths must overlap)"
        )
        raise InputError(folder, line, None, "; ".join([remedy, *notes]))
    return _cut(reached, origins)


def _attached(first: Vessel, lines: list[Vessel]) -> tuple[list[Vessel], dict[str, tuple[str, float]], float, tuple]:
    """Attach lines to the root `first`, nearest first; return them, their origins, and the largest gap."""
    reached, left = [first], [v for v in lines if v is not first]
    origins: dict[str, tuple[str, float]] = {}
    worst, worst_pair = 0.0, ("", "")
    while left:
        options = []
        for line in left:
            for other in reached:
                arc, distance = project(other, line.points[0])
                options.append((distance / float(other.radius_at(arc)), line, other, arc))
        relative, line, other, arc = min(options, key=lambda option: option[0])
        if relative > worst:
            worst, worst_pair = relative, (line.name, other.name)
        origins[line.name] = (other.name, arc)
        reached.append(line)
        left = [v for v in left if v is not line]
    return reached, origins, worst, worst_pair


def _cut(lines: list[Vessel], origins: dict[str, tuple[str, float]]) -> Tree:
    """Cut lines at bifurcations; the last part of a line keeps its name, earlier parts add _1, _2, ..."""
    vessels: list[Vessel] = []
    piece_at: dict[str, list[tuple[float, str]]] = {}
    for line in lines:
        least = 0.5 * float(np.median(line.radii))
        arcs = sorted(arc for other, arc in origins.values() if other == line.name)
        cuts: list[float] = []
        for arc in arcs:
            arc = min(max(arc, least), line.length - least)
            if not cuts or arc - cuts[-1] > least:
                cuts.append(arc)
        ends = [*cuts, line.length]
        names = [f"{line.name}_{k + 1}" for k in range(len(cuts))] + [line.name]
        parent = None
        start_point = None
        if line.name in origins:
            other, arc = origins[line.name]
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
    """Return the centres and radii of a path's contours in order along it; None with fewer than two contours."""
    root = _xml(path)
    control = _points(path, root, ".//control_points/point")
    if len(control) < 2:
        raise InputError(path, "control_points", len(control), "expected two or more points")
    if path.stem not in groups:
        return None
    centres, radii = [], []
    group = groups[path.stem]
    for contour in sorted(_xml(group).iter("contour"), key=_path_point):
        rim = _points(group, contour, "contour_points/point")
        if len(rim) < 3:
            continue
        centre = rim.mean(axis=0)
        area = 0.5 * np.linalg.norm(np.cross(rim - centre, np.roll(rim, -1, axis=0) - centre).sum(axis=0))
        if area <= 0.0:
            raise InputError(group, f"contour {contour.get('id')}", None, "has no area; redraw it")
        centres.append(centre)
        radii.append(np.sqrt(area / np.pi))
    if len(centres) < 2:
        return None
    # Contours begin where the artery has left its parent; the path's own points lead there from its origin.
    along = centres[1] - centres[0]
    lead = control[: np.argmin(np.linalg.norm(control - centres[0], axis=1)) + 1]
    lead = lead[(lead - centres[0]) @ along < -1e-6 * float(along @ along)]
    return Contoured(path.stem, np.vstack([lead, centres]), np.concatenate([np.full(len(lead), radii[0]), radii]))


def _path_point(contour: ElementTree.Element) -> int:
    """Return the path point of a contour; files need not contain contours in that order."""
    point = contour.find("path_point")
    number = "" if point is None else point.get("id", "")
    return int(number) if number.isdigit() else 0


def _xml(path: Path) -> ElementTree.Element:
    if path.stat().st_size > LARGEST:
        raise InputError(path, None, f"{path.stat().st_size} bytes", f"more than {LARGEST} bytes")
    text = path.read_text(encoding="utf-8", errors="replace")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(path, None, None, "contains a document type definition, which SimVascular never writes")
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
        raise InputError(path, where, None, f"a point lacks x, y or z ({error})") from None
    if not np.isfinite(points).all():
        raise InputError(path, where, None, "a point is not finite")
    return points.reshape(-1, 3)
