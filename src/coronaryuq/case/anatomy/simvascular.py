"""SimVascular projects: paths (.pth) and contour groups (.ctgr) become a centreline tree."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

from coronaryuq.case.anatomy.simvascular_xml import read_points, read_xml
from coronaryuq.case.anatomy.synthetic_aorta import is_aorta, one_tree
from coronaryuq.case.anatomy.tree import Tree, Vessel, project, tree_of
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.text import visible

SPACING = 0.05
"""cm between centreline points."""
AT_END = 0.1
"""Radii from the end of a line, within which others that start there are its continuation."""
ATTACH = 1.5
"""A path branches off another if it starts within this many radii of it."""
INSIDE, FREE = 0.5, 3.0
"""A line longer than `FREE` radii that ends within `INSIDE` radii of another's axis runs into it."""
SEPARATE, MOST_TREES = 1.0, 3
"""cm between trees that have nothing to do with one another (nearer ones ought to touch), and their largest number:
left, right, and a circumflex or conus artery with an ostium of its own."""


@dataclass(frozen=True)
class Contoured:
    """One path with its contours: name, points (n, 3) and radii (n,) of discs of the contours' areas, in file units."""

    name: str
    points: np.ndarray
    radii: np.ndarray


def read_project(folder: str | Path, scale: float, chosen: Sequence[str] = ()) -> tuple[Tree, tuple[str, ...]]:
    """Read the tree of a project with Paths/*.pth and Segmentations/*.ctgr; `scale` is its length unit in cm.

    chosen: the contour groups to use, where a path has several. Also returns notes. Every path that has contours
    becomes a vessel, from its first control point on; it starts on the path nearest there. Raises InputError for a
    missing folder, a broken file and a path that touches no other.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, None, None, "no such folder; expected a SimVascular project with Paths, Segmentations")
    paths, groups = list(_files(folder, "Paths", ".pth")), list(_files(folder, "Segmentations", ".ctgr"))
    if not paths or not groups:
        raise InputError(folder, None, None, "expected Paths/*.pth and Segmentations/*.ctgr")
    of_path, without_path, notes = _groups_of_paths(folder, [_name(path) for path in paths], groups, chosen)
    notes += _contradicting_ids(paths, of_path)
    contoured = {_name(path): _contoured(path, of_path.get(_name(path)), notes) for path in paths}
    left_out = [name for name, contours in contoured.items() if contours is None]
    lines = [_line(c.name, c.points * scale, c.radii * scale) for c in contoured.values() if c is not None]
    if not lines:
        raise InputError(
            folder, "Segmentations", None, "no path has a contour group of the same name with two or more contours"
        )
    if left_out:
        notes.append(f"left out paths with fewer than two contours: {', '.join(left_out)}")
    if without_path:
        notes.append(f"left out contour groups without a path in Paths: {', '.join(without_path)}")
    trees, _ = join_lines(folder, lines, notes, complete=not left_out and not without_path)
    return one_tree(folder, trees, notes), tuple(notes)


def _name(file: Path) -> str:
    """Return the name of a path or contour group, which is that of its file."""
    return file.stem.strip()


def is_project(folder: Path) -> bool:
    """Return whether a folder holds paths and contour groups."""
    return any(_files(folder, "Paths", ".pth")) and any(_files(folder, "Segmentations", ".ctgr"))


def _files(folder: Path, inside: str, ending: str) -> Iterator[Path]:
    """Yield the files of a project's folder; a copy from another system may have changed capitals."""
    for child in sorted(folder.glob("*")):
        if child.name.lower() != inside.lower():
            continue
        yield from (file for file in visible(child) if file.suffix.lower() == ending)


def _line(name: str, points: np.ndarray, radii: np.ndarray) -> Vessel:
    """Interpolate contour centres (modified Akima splines, which overshoot little) and radii (monotone cubics)."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    kept = np.concatenate([[True], np.diff(arc) > 0.0])
    arc, points, radii = arc[kept], points[kept], radii[kept]
    fine = np.linspace(0.0, arc[-1], max(2, int(np.ceil(arc[-1] / (0.25 * SPACING))) + 1))
    course = Akima1DInterpolator(arc, points, axis=0, method="makima")(fine)
    return Vessel(name, course, PchipInterpolator(arc, radii)(fine)).resampled(SPACING)


def _groups_of_paths(
    folder: Path, paths: Sequence[str], groups: Sequence[Path], chosen: Sequence[str]
) -> tuple[dict[str, Path], list[str], list[str]]:
    """Return the contour group of every path that has one, the groups without a path, and notes.

    A group names its path; one that names none, or none that there is, is of the path of its own name.
    """
    stems = [_name(group) for group in groups]
    for name in chosen:
        if name not in stems:
            raise InputError(folder, "anatomy.groups", name, f"no such contour group; there are {', '.join(stems)}")
    candidates: dict[str, list[Path]] = {}
    without_path = []
    for group in groups:
        path = next((name for name in (_path_name(group), _name(group)) if name in paths), None)
        if path is None:
            without_path.append(_name(group))
        else:
            candidates.setdefault(path, []).append(group)
    found, notes = {}, []
    for path, several in candidates.items():
        wanted = [group for group in several if _name(group) in chosen] or several
        own = [group for group in wanted if _name(group) == path]
        if len(wanted) > 1 and not own:
            names = ", ".join(_name(group) for group in wanted)
            remedy = f"several contour groups are of this path: {names}; name the one to use in anatomy.groups"
            raise InputError(folder / "Segmentations", "path_name", path, remedy)
        found[path] = (own or wanted)[0]
        if len(wanted) > 1:
            others = ", ".join(_name(group) for group in wanted if _name(group) != path)
            notes.append(f"path {path}: took the contour group of its own name, not {others} (anatomy.groups)")
    return found, without_path, notes


def _path_name(group: Path) -> str:
    """Return the name of the path that a contour group belongs to, by default the file's own name."""
    root = read_xml(group).find("contourgroup")
    return _name(group) if root is None else root.get("path_name", _name(group)).strip()


def _contradicting_ids(paths: Sequence[Path], of_path: Mapping[str, Path]) -> list[str]:
    """Return a note for each group whose `path_id` is that of another path than its `path_name`."""
    ids = {_name(path): found.get("id", "") for path in paths if (found := read_xml(path).find("path")) is not None}
    notes = []
    for name, group in of_path.items():
        root = read_xml(group).find("contourgroup")
        stated = "" if root is None else root.get("path_id", "")
        others = [other for other, number in ids.items() if number == stated]
        if len(others) == 1 and others[0] != name:
            notes.append(
                f"{group.name}: took path {name} of its path_name; its path_id {stated} is that of {others[0]}"
            )
    return notes


def _one_time(path: Path, notes: list[str]) -> ElementTree.Element:
    """Return the content of a file, of several time steps that are not empty the first."""
    root = read_xml(path)
    of_kind = [element for name in ("path", "contourgroup") for element in root.iter(name)]
    if len(of_kind) > 1:
        raise InputError(path, of_kind[0].tag, len(of_kind), "several in one file; give each its own")
    if not of_kind:
        raise InputError(path, None, None, "holds no path or contour group; save it again in SimVascular, or delete it")
    steps = [step for step in root.iter("timestep") if len(step)]
    if len(steps) > 1:
        notes.append(f"{path.name}: took the first of {len(steps)} time steps")
    return steps[0] if steps else root


def join_lines(
    folder: Path, lines: list[Vessel], notes: Sequence[str] = (), complete: bool = True
) -> tuple[list[Tree], dict[str, str]]:
    """Join lines to trees: each starts at the nearest point of another line, which is cut there.

    The root is the line for which the others start closest to their parents. Coronary lines that are far from all
    others are trees of their own; a line that only misses its parent is an error. notes: appended to it.
    complete: whether no line was left out, without which others may seem to be trees of their own.

    Returns
    -------
    list of Tree
        Parents before children.
    dict of str to str
        Vessel → the line of which it is a part.
    """
    groups = _groups(lines)
    if len(groups) > 1:
        _check_separate(folder, groups, notes, complete)
    taken = {line.name for line in lines}
    trees: list[Tree] = []
    line_of: dict[str, str] = {}
    for group in groups:
        attempts = [_attached(first, group) for first in group]
        reached, origins, worst, (line, other) = min(attempts, key=lambda attempt: attempt[2])
        if worst > ATTACH:
            raise _gap(folder, line, worst, other, notes, group)
        _refuse_loops(folder, reached, origins)
        with tree_of(folder):
            vessels, parts = _cut(reached, origins, taken)
        trees.append(vessels)
        line_of |= parts
    return trees, line_of


def _refuse_loops(folder: Path, lines: Sequence[Vessel], origins: Mapping[str, tuple[str, float]]) -> None:
    """Raise InputError for a line that ends inside another one, as a bypass graft does."""
    for line in lines:
        for other in lines:
            parent, _ = origins.get(line.name, ("", 0.0))
            if other is line or other.name == parent:
                continue
            arc, distance = project(other, line.points[-1])
            radius = float(other.radius_at(arc))
            starts_there = origins.get(other.name, ("", 0.0))[0] == line.name and arc < line.radii[-1] + radius
            if distance < INSIDE * radius and line.length > FREE * radius and not starts_there:
                remedy = f"ends inside {other.name}: bypass grafts and other loops cannot be modelled; leave it out"
                raise InputError(folder, line.name, None, remedy)


def _gap(
    folder: Path, line: str, radii: float, other: str, notes: Sequence[str], lines: Sequence[Vessel]
) -> InputError:
    remedy = f"path starts {radii:.1f} radii from {other}, the nearest; expected at most {ATTACH} (paths must overlap)"
    backwards = [v.name for v in lines if v.name == line and _end_touches(v, lines)]
    if backwards:
        remedy += "; it ends on another path: does it run backwards?"
    return InputError(folder, line, None, "; ".join([remedy, *notes]))


def _end_touches(line: Vessel, lines: Sequence[Vessel]) -> bool:
    """Whether a line ends within `ATTACH` radii of another one."""
    for other in lines:
        arc, distance = project(other, line.points[-1])
        if other is not line and distance <= ATTACH * float(other.radius_at(arc)):
            return True
    return False


def _groups(lines: list[Vessel]) -> list[list[Vessel]]:
    """Return the lines in groups that touch: one starts within `ATTACH` radii of another; the longest group first."""
    group_of = list(range(len(lines)))
    for k, line in enumerate(lines):
        for j, other in enumerate(lines):
            if j != k and group_of[j] != group_of[k] and _away(line, other)[0] <= ATTACH:
                old = group_of[k]
                group_of = [group_of[j] if group == old else group for group in group_of]
    groups = [
        [line for line, group in zip(lines, group_of, strict=True) if group == k] for k in dict.fromkeys(group_of)
    ]
    return sorted(groups, key=lambda group: -sum(line.length for line in group))


def _away(line: Vessel, other: Vessel) -> tuple[float, float]:
    """Return how far a line starts from another one: in radii of that, and in cm."""
    arc, distance = project(other, line.points[0])
    return distance / float(other.radius_at(arc)), distance


def _check_separate(folder: Path, groups: list[list[Vessel]], notes: Sequence[str], complete: bool) -> None:
    """Raise InputError unless the groups are coronary trees that have nothing to do with one another."""
    with_aorta = any(is_aorta(line) for group in groups for line in group)
    for group in groups[1:]:
        others = [line for other in groups if other is not group for line in other]
        # The line of the group that would be attached, and where.
        radii, distance, line, other = min(
            (*_away(line, other), line.name, other.name) for line in group for other in others
        )
        if not complete or with_aorta or len(groups) > MOST_TREES or distance < SEPARATE:
            raise _gap(folder, line, radii, other, notes, [line for group in groups for line in group])


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


def _cut(lines: list[Vessel], origins: dict[str, tuple[str, float]], taken: set[str]) -> tuple[Tree, dict[str, str]]:
    """Cut lines at bifurcations; the last part of a line keeps its name, earlier parts add _1, _2, ...

    taken: names that no part may have. Also returns the line of every vessel.
    """
    line_of: dict[str, str] = {}
    vessels: list[Vessel] = []
    piece_at: dict[str, list[tuple[float, str]]] = {}
    for line in lines:
        least = 0.5 * float(np.median(line.radii))
        arcs = sorted(arc for other, arc in origins.values() if other == line.name)
        cuts: list[float] = []
        for arc in arcs:
            if _at_end(line, arc):
                continue
            arc = min(max(arc, least), line.length - least)
            if not cuts or arc - cuts[-1] > least:
                cuts.append(arc)
        ends = [*cuts, line.length]
        names = [_free(f"{line.name}_{k + 1}", taken) for k in range(len(cuts))] + [line.name]
        line_of |= dict.fromkeys(names, line.name)
        parent = None
        start_point = None
        if line.name in origins:
            other, arc = origins[line.name]
            whole = next(candidate for candidate in lines if candidate.name == other)
            parent = other if _at_end(whole, arc) else min(piece_at[other], key=lambda entry: abs(entry[0] - arc))[1]
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
    return Tree(vessels), line_of


def _free(name: str, taken: set[str]) -> str:
    """Return a name that nothing has yet, this one if possible, and take it."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _at_end(line: Vessel, arc: float) -> bool:
    """Whether a place is the end of a line, which then goes on as the lines that start there."""
    return arc > line.length - AT_END * float(line.radii[-1])


def _contoured(path: Path, group: Path | None, notes: list[str]) -> Contoured | None:
    """Return the centres and radii of a path's contours in order along it; None with fewer than two contours."""
    root = _one_time(path, notes)
    control = read_points(path, root, ".//control_points/point")
    if len(control) < 2:
        raise InputError(path, "control_points", len(control), "expected two or more points")
    if group is None:
        return None
    centres, radii = [], []
    contours = sorted(_one_time(group, notes).iter("contour"), key=_path_point)
    places = [point.get("id") for contour in contours for point in contour.findall("path_point")]
    for place in places:
        if places.count(place) > 1:
            raise InputError(group, "path_point", place, "has several contours; delete all but one")
    for contour in contours:
        rim = read_points(group, contour, "contour_points/point")
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
    return Contoured(_name(path), np.vstack([lead, centres]), np.concatenate([np.full(len(lead), radii[0]), radii]))


def _path_point(contour: ElementTree.Element) -> int:
    """Return the path point of a contour; files need not contain contours in that order."""
    point = contour.find("path_point")
    number = "" if point is None else point.get("id", "")
    return int(number) if number.isascii() and number.isdigit() else 0
