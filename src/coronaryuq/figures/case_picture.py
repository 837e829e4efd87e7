"""The vessels of a case as `coronaryuq check` understood them, before any campaign."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.collections import LineCollection
from scipy.spatial import cKDTree

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel, area_ratio
from coronaryuq.case.sketch import EndRole, Sketch
from coronaryuq.core.units import percent
from coronaryuq.figures.label_places import Box, Discs, place_labels
from coronaryuq.figures.style import DARK, Output, colour, saved

MOST_CELLS = 4000
"""Cells of the wall that are drawn."""
SCALE_BARS = (0.5, 1.0, 2.0, 5.0)
"""cm."""
UNKNOWN, STENOSIS, WIRE, READ = "#CC79A7", "#F0E442", "#7B3294", "#E0218A"
"""Of ends without a row, of stenoses, of a pressure wire's places, of places where FFR is read; no artery has them."""
RING = {"marker": "o", "ls": "none", "ms": 7, "mfc": "none", "mec": READ, "mew": 1.6, "zorder": 6}
DIAMOND = {"marker": "D", "ls": "none", "color": WIRE, "ms": 6, "mec": "white", "mew": 0.8, "zorder": 6}
WIDTH, KEY = 7.5, 0.9
"""Inches: width of the figure, and height of scale bar and legend."""
LETTER, LINE = 0.056, 0.125
"""Inches: width of a letter and height of a line of a label."""
STENOSIS_WIDTH = 6.0
"""Points."""
POINT = 1 / 72
"""Inches."""
DOT_SIZE, RING_SIZE, DIAMOND_SIZE = 5.6, 8.6, 9.6
"""Points: diameters of the markers with their edges."""
PASSES = 8
"""Most passes in which labels are placed."""
SPACING = 0.01
"""Of the points along vessels that labels shall not cover, over the extent of the tree."""


def case_picture(sketch: Sketch, output: Output) -> None:
    """Draw tree, ends, stenoses, places of a pressure wire, territories if there is a map, and a scale bar.

    Parameters
    ----------
    sketch
        What was understood; it has a tree.
    output
        PNG or SVG files.
    """
    tree = sketch.tree
    assert tree is not None
    roles = sketch.roles()
    flat = _plane(tree)
    places = _places(sketch, tree, roles)
    rings = [tree[s.vessel].position_at(s.read.arc)[None] for s in sketch.stenoses if s.read is not None]
    boxes, low, high = _layout(places, rings, sketch, flat)
    size = (WIDTH, float(np.clip(WIDTH * (high - low)[1] / (high - low)[0] + KEY, 0.4 * WIDTH, 1.3 * WIDTH)))
    with saved(output, figsize=size) as (figure, axes):
        if sketch.wall is not None:
            _territories(axes, sketch, flat)
        for vessel in tree:
            _vessel(axes, vessel, flat)
        for stenosis in sketch.stenoses:
            part = tree[stenosis.vessel].between(stenosis.start, stenosis.end)
            for ink, lw in ((DARK, STENOSIS_WIDTH), (STENOSIS, 3.5)):
                axes.plot(*flat(part.points).T, color=ink, lw=lw, solid_capstyle="butt", zorder=4)
        for ring in rings:
            axes.plot(*flat(ring)[0], **RING)
        for place in sketch.wire_places:
            axes.plot(*flat(tree[place.vessel].position_at(place.arc))[0], **DIAMOND)
        _label(axes, places, boxes, flat)
        axes.set_aspect("equal")
        axes.axis("off")
        axes.update_datalim([low, high])
        axes.margins(0.02)
        _scale_bar(axes)
        _legend(figure, axes, tree, roles, sketch)


@dataclass(frozen=True)
class _Place:
    """A position (3,) cm, its label and colour, and the size of its marker, zero without one."""

    point: np.ndarray
    text: str
    ink: str
    size: float


def _words(role: EndRole) -> tuple[str, str, float]:
    """Return label, colour and size of the marker of an end."""
    text = role.name if role.label == role.name else f"{role.label} ({role.name})"
    if role.artery is None:
        return f"{text}?", UNKNOWN, DOT_SIZE
    if role.artery == AORTA:
        return (f"{text}, added" if role.vessel.made else text), "#555555", DOT_SIZE
    return (f"{text} → {role.feeds}" if role.feeds != "LV" else text), colour(role.artery), DOT_SIZE


def _plane(tree: Tree):
    """Return the projection (n, 3) → (n, 2) onto the plane in which the coronary ends are spread most."""
    coronary = [v for v in tree if v.branch != AORTA] or list(tree)
    points = np.concatenate([v.points for v in coronary])
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre, full_matrices=False)
    across = axes[:2] * np.where(axes[:2].sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return lambda positions: (np.atleast_2d(positions) - centre) @ across.T


def _vessel(axes, vessel: Vessel, flat) -> None:
    line = flat(vessel.points)
    aortic = vessel.branch == AORTA
    ink = "#DDDDDD" if aortic else DARK if vessel.branch in ("LM", "coronary") else colour(vessel.branch)
    widths = _widths(vessel.radii)
    pieces = np.stack([line[:-1], line[1:]], axis=1)
    axes.add_collection(
        LineCollection(
            list(pieces), linewidths=list(widths[:-1]), colors=ink, capstyle="round", zorder=1 if aortic else 3,
        )
    )  # fmt: skip
    axes.update_datalim(line)


def _widths(radii: np.ndarray) -> np.ndarray:
    """Return the widths, in points, with which a vessel is drawn."""
    return np.clip(30.0 * radii, 1.0, 9.0)


def _places(sketch: Sketch, tree: Tree, roles: Sequence[EndRole]) -> list[_Place]:
    """Return what is labelled: ends, stenoses and places of a pressure wire."""
    places = [_Place(role.vessel.points[-1], *_words(role)) for role in roles]
    for stenosis in sketch.stenoses:
        text = f"{stenosis.name} stenosis, {percent(1 - area_ratio(tree, stenosis))} of the area"
        if stenosis.read is not None:
            text += f"\nFFR {10 * (stenosis.read.arc - stenosis.end):.0f} mm beyond it"
        middle = tree[stenosis.vessel].position_at((stenosis.start + stenosis.end) / 2)
        places.append(_Place(middle, text, DARK, 0.0))
    for place in sketch.wire_places:
        measured = "" if place.measured is None else f", measured {place.measured:.2f}"
        point = tree[place.vessel].position_at(place.arc)
        places.append(_Place(point, f"FFR at {place.name}{measured}", WIRE, DIAMOND_SIZE))
    return places


def _layout(
    places: Sequence[_Place], rings: Sequence[np.ndarray], sketch: Sketch, flat
) -> tuple[list[Box], np.ndarray, np.ndarray]:
    """Return the labels' boxes, and the lower left and upper right corner of all that is drawn.

    The size of letters in cm follows from the extent with labels, which follows from it: passes are made until it is
    the one that the labels were placed with.
    """
    tree = sketch.tree
    assert tree is not None
    drawn = [flat(vessel.points) for vessel in tree]
    wall = [] if sketch.wall is None else [flat(_cells(sketch))]
    extent = np.concatenate(drawn + wall)
    low, high = extent.min(axis=0), extent.max(axis=0)
    span = float(np.ptp(np.concatenate(drawn), axis=0).max())
    along, widths = _lines(tree, {s.vessel for s in sketch.stenoses}, SPACING * span)
    points = flat(np.array([place.point for place in places]))
    marked = np.array([place.size > 0.0 for place in places])
    centres = np.concatenate([points[marked], *(flat(ring) for ring in rings)])
    sizes = np.array([place.size for place in places if place.size > 0.0] + [RING_SIZE] * len(rings))
    boxes: list[Box] = []
    inch = 0.0
    for _ in range(PASSES):
        needed = max((high - low)[0] / (0.96 * WIDTH), (high - low)[1] / (1.3 * WIDTH - KEY))
        if needed <= 1.01 * inch:
            break
        inch = needed
        point = POINT * inch
        lines, markers = Discs(flat(along), widths * point / 2), Discs(centres, sizes * point / 2)
        boxes = place_labels(points, [_size(place.text, inch) for place in places], lines, markers, span)
        corners = np.concatenate([extent, *(box.corners for box in boxes)])
        low, high = corners.min(axis=0), corners.max(axis=0)
    return boxes, low, high


def _lines(tree: Tree, stenosed: Collection[str], spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 3) along all vessels and the widths (n,), in points, with which these are drawn there."""
    points, widths = [], []
    for vessel in tree:
        arc = np.arange(0.0, vessel.length + spacing, spacing)
        points.append(vessel.position_at(arc))
        drawn = _widths(np.interp(arc, vessel.arc, vessel.radii))
        widths.append(np.maximum(drawn, STENOSIS_WIDTH) if vessel.name in stenosed else drawn)
    return np.concatenate(points), np.concatenate(widths)


def _size(text: str, inch: float) -> tuple[float, float]:
    """Return width and height of a label, cm; inch: cm of the drawing per inch of the figure."""
    words = text.split("\n")
    return LETTER * inch * max(map(len, words)), (LINE * len(words) + 0.03) * inch


def _label(axes, places: Sequence[_Place], boxes: Sequence[Box], flat) -> None:
    """Mark ends by dots and write the labels beside their points."""
    for place, box in zip(places, boxes, strict=True):
        at = flat(place.point)[0]
        if place.size == DOT_SIZE:
            axes.plot(*at, "o", color=place.ink, ms=5, mec="white", mew=0.6, zorder=5)
        axes.annotate(
            place.text, at, xytext=box.anchor, textcoords="data", ha="left" if box.right else "right", va="center",
            fontsize=7, color=place.ink, zorder=6,
            arrowprops={"arrowstyle": "-", "color": place.ink, "lw": 0.5, "relpos": (0.0 if box.right else 1.0, 0.5)},
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.6},
        )  # fmt: skip


def _territories(axes, sketch: Sketch, flat) -> None:
    """Draw the cells of the wall in the colour of the artery whose outlet is nearest."""
    feeding = [outlet for outlet in sketch.outlets if outlet.perfuses == "LV"]
    centres = _cells(sketch)
    _, nearest = cKDTree(np.array([outlet.point for outlet in feeding])).query(centres)
    inks = np.array([colour(outlet.branch) for outlet in feeding])[nearest]
    axes.scatter(*flat(centres).T, s=6, c=inks, alpha=0.12, lw=0, zorder=0)


def _cells(sketch: Sketch) -> np.ndarray:
    """Return the centres (n, 3) of the cells of the wall that are drawn."""
    centres = np.asarray(sketch.wall.mesh.cell_centers().points, dtype=np.float64)  # type: ignore[union-attr]
    return centres[:: max(1, len(centres) // MOST_CELLS)]


def _scale_bar(axes) -> None:
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    length = next((bar for bar in reversed(SCALE_BARS) if bar < 0.3 * (right - left)), SCALE_BARS[0])
    height = bottom - 0.03 * (top - bottom)
    axes.plot([left, left + length], [height] * 2, color=DARK, lw=2.0, solid_capstyle="butt", clip_on=False)
    axes.annotate(
        f"{length:g} cm", (left + length / 2, height), xytext=(0, -3), textcoords="offset points", ha="center", va="top"
    )


def _legend(figure, axes, tree: Tree, roles: list[EndRole], sketch: Sketch) -> None:
    names = [a for a in ("LAD", "LCx", "RCA") if any(role.artery == a for role in roles)]
    shown = [(name, colour(name)) for name in names]
    shown += [("left main or trunk", DARK)] if any(v.branch in ("LM", "coronary") for v in tree) else []
    shown += [("aorta", "#DDDDDD")] if any(v.branch == AORTA for v in tree) else []
    shown += [("stenosis", STENOSIS)] if sketch.stenoses else []
    shown += (
        [("what is it?" if sketch.beds else "no row: what is it?", UNKNOWN)]
        if any(role.artery is None for role in roles)
        else []
    )
    handles = [axes.plot([], [], color=ink, lw=3, label=name)[0] for name, ink in shown]
    if any(stenosis.read is not None for stenosis in sketch.stenoses):
        handles += axes.plot([], [], **RING, label="FFR is read")
    if sketch.wire_places:
        handles += axes.plot([], [], **DIAMOND, label="pressure wire")
    title = "" if sketch.unit is None else f"read in {sketch.unit}"
    title += "; territories: nearest outlet" if sketch.wall is not None else ""
    columns = len(handles) if len(handles) <= 7 else -(-len(handles) // 2)
    style = {"loc": "outside lower center", "ncols": columns, "fontsize": 7, "title_fontsize": 7}
    figure.legend(handles=handles, title=title or None, **style)
