"""The vessels of a case as `coronaryuq check` understood them, before any campaign."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.collections import LineCollection
from scipy.spatial import cKDTree

from coronaryuq.case.anatomy.tree import AORTA, Tree, Vessel, area_ratio
from coronaryuq.case.sketch import EndRole, Sketch
from coronaryuq.figures.style import DARK, Output, colour, saved

MOST_CELLS = 4000
"""Cells of the wall that are drawn."""
SCALE_BARS = (0.5, 1.0, 2.0, 5.0)
"""cm."""
UNKNOWN, STENOSIS, WIRE = "#CC79A7", "#F0E442", "#7B3294"
"""Of ends without a row, of stenoses and of a pressure wire's places; no artery has them."""
WIDTH = 7.5
"""Inches."""
LETTER = 0.0135
"""Width of a letter of a label, over the extent of the tree."""


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
    wide, high = np.ptp(np.concatenate([flat(v.points) for v in tree]), axis=0)
    size = (WIDTH, float(np.clip(WIDTH * high / wide + 0.8, 0.4 * WIDTH, 1.2 * WIDTH)))
    with saved(output, figsize=size) as (_, axes):
        if sketch.wall is not None:
            _territories(axes, sketch, flat)
        for vessel in tree:
            _vessel(axes, vessel, flat)
        places = [_Place(role.vessel.points[-1], *_words(role)) for role in roles]
        for stenosis in sketch.stenoses:
            part = tree[stenosis.vessel].between(stenosis.start, stenosis.end)
            for ink, lw in ((DARK, 6.0), (STENOSIS, 3.5)):
                axes.plot(*flat(part.points).T, color=ink, lw=lw, solid_capstyle="butt", zorder=4)
            text = f"{stenosis.name} stenosis, {1 - area_ratio(tree, stenosis):.0%} of the area"
            places.append(_Place(part.position_at(part.length / 2), text, DARK, False))
        for place in sketch.wire_places:
            point = tree[place.vessel].position_at(place.arc)
            axes.plot(*flat(point)[0], "D", color=WIRE, ms=6, mec="white", mew=0.8, zorder=6)
            measured = "" if place.measured is None else f", measured {place.measured:.2f}"
            places.append(_Place(point, f"FFR at {place.name}{measured}", WIRE, False))
        _label(axes, places, flat, max(wide, high))
        axes.set_aspect("equal")
        axes.axis("off")
        axes.margins(0.08)
        _scale_bar(axes)
        _legend(axes, tree, roles, sketch)


@dataclass(frozen=True)
class _Place:
    """A position (3,) cm, its label and colour, and whether it is marked by a dot."""

    point: np.ndarray
    text: str
    ink: str
    dot: bool


def _words(role: EndRole) -> tuple[str, str, bool]:
    """Return label and colour of an end."""
    text = role.name if role.label == role.name else f"{role.label} ({role.name})"
    if role.artery is None:
        return f"{text}?", UNKNOWN, True
    if role.artery == AORTA:
        return (f"{text}, added" if role.vessel.made else text), "#555555", True
    return (f"{text} → {role.feeds}" if role.feeds != "LV" else text), colour(role.artery), True


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
    widths = np.clip(30.0 * vessel.radii, 1.0, 9.0)
    pieces = np.stack([line[:-1], line[1:]], axis=1)
    axes.add_collection(
        LineCollection(
            list(pieces), linewidths=list(widths[:-1]), colors=ink, capstyle="round", zorder=1 if aortic else 3,
        )
    )  # fmt: skip
    axes.update_datalim(line)


def _label(axes, places: Sequence[_Place], flat, span: float) -> None:
    """Write labels outwards from the middle, each moved until it covers no earlier one."""
    centre = flat(np.mean([place.point for place in places], axis=0))[0]
    taken: list[tuple[float, float, float]] = []
    for place in places:
        at = flat(place.point)[0]
        if place.dot:
            axes.plot(*at, "o", color=place.ink, ms=5, mec="white", mew=0.6, zorder=5)
        outwards = (at - centre) / max(float(np.linalg.norm(at - centre)), 1e-9)
        label, length = at + 0.035 * span * outwards, LETTER * span * len(place.text)
        right = outwards[0] >= 0
        left = at[0] + 0.035 * span * outwards[0] - (0.0 if right else length)
        while any(abs(label[1] - y) < 0.03 * span and left < x + w and x < left + length for x, y, w in taken):
            label = label + [0.0, 0.01 * span * (1.0 if outwards[1] >= 0 else -1.0)]
        taken.append((left, label[1], length))
        axes.annotate(
            place.text, at, xytext=label, textcoords="data", ha="left" if right else "right", va="center", fontsize=7,
            color=place.ink, zorder=6, arrowprops={"arrowstyle": "-", "color": place.ink, "lw": 0.5},
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.6},
        )  # fmt: skip
        axes.update_datalim([label, label + [length if right else -length, 0.0]])


def _territories(axes, sketch: Sketch, flat) -> None:
    """Draw the cells of the wall in the colour of the artery whose outlet is nearest."""
    feeding = [outlet for outlet in sketch.outlets if outlet.perfuses == "LV"]
    centres = np.asarray(sketch.wall.mesh.cell_centers().points, dtype=np.float64)  # type: ignore[union-attr]
    centres = centres[:: max(1, len(centres) // MOST_CELLS)]
    _, nearest = cKDTree(np.array([outlet.point for outlet in feeding])).query(centres)
    inks = np.array([colour(outlet.branch) for outlet in feeding])[nearest]
    axes.scatter(*flat(centres).T, s=6, c=inks, alpha=0.12, lw=0, zorder=0)


def _scale_bar(axes) -> None:
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    length = next((bar for bar in reversed(SCALE_BARS) if bar < 0.3 * (right - left)), SCALE_BARS[0])
    height = bottom - 0.03 * (top - bottom)
    axes.plot([left, left + length], [height] * 2, color=DARK, lw=2.0, solid_capstyle="butt", clip_on=False)
    axes.annotate(
        f"{length:g} cm", (left + length / 2, height), xytext=(0, -3), textcoords="offset points", ha="center", va="top"
    )


def _legend(axes, tree: Tree, roles: list[EndRole], sketch: Sketch) -> None:
    names = [a for a in ("LAD", "LCx", "RCA") if any(role.artery == a for role in roles)]
    shown = [(name, colour(name)) for name in names]
    shown += [("left main or trunk", DARK)] if any(v.branch in ("LM", "coronary") for v in tree) else []
    shown += [("aorta", "#DDDDDD")] if any(v.branch == AORTA for v in tree) else []
    shown += [("stenosis", STENOSIS)] if sketch.stenoses else []
    shown += [("pressure wire", WIRE)] if sketch.wire_places else []
    shown += (
        [("what is it?" if sketch.beds else "no row: what is it?", UNKNOWN)]
        if any(role.artery is None for role in roles)
        else []
    )
    handles = [axes.plot([], [], color=ink, lw=3, label=name)[0] for name, ink in shown]
    title = "" if sketch.unit is None else f"read in {sketch.unit}"
    title += "; territories: nearest outlet" if sketch.wall is not None else ""
    axes.legend(handles=handles, title=title or None, loc="best", fontsize=7, title_fontsize=7)
