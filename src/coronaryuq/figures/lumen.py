"""Flow along the lesions as curved-planar views: the lumen straightened along its centreline."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyvista as pv
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel, placed_stenoses, read_tree, throat
from coronaryuq.case.case_json import read_case
from coronaryuq.core.units import MMHG
from coronaryuq.figures.scenes import first_field
from coronaryuq.figures.style import Output, colour, saved
from coronaryuq.flow3d.mesh.description import Plane, read_description

BEFORE, BEHIND = 1.2, 1.0
"""Length shown upstream of a lesion, and beyond the plane of FFR or the lesion's end, cm."""
FINE = 0.006
"""Distance between the points of the view, cm."""
WIDE = 1.4
"""Half the width of the view over the largest radius."""
STRETCH = 2.0
"""Scale across the artery over that along it."""


@dataclass(frozen=True)
class Straightened:
    """A lumen along its artery.

    along: (n,) cm from the throat. across: (m,) cm. values: name → (m, n), nan outside the lumen. lesion: start and
    end of the stenosis, cm from the throat. read: where FFR is read, cm from the throat, None if not in this view.
    """

    along: np.ndarray
    across: np.ndarray
    values: dict[str, np.ndarray]
    lesion: tuple[float, float]
    read: float | None


def lumen(fields: str, case: str, tree: str, mesh: str, output: Output) -> None:
    """Draw cycle means of speed and pressure of the first sample along each lesion; blood flows from left to right."""
    inside = first_field(fields, ".vtu")
    inside["speed"] = np.linalg.norm(inside["mean_velocity"], axis=1)
    inside["mmHg"] = inside["mean_pressure"] / MMHG
    vessels, planes = read_tree(tree), read_description(mesh).planes
    stenoses = placed_stenoses(read_case(case).stenoses)
    views = [straightened(inside, vessels, one, planes) for one in stenoses]
    panels = (("speed", "magma", "mean speed (cm/s)"), ("mmHg", "viridis", "mean pressure (mmHg)"))
    size = (9.0, 1.05 * len(views) + 0.6)
    with saved(output, nrows=max(1, len(views)), ncols=2, figsize=size, squeeze=False) as (figure, axes):
        for column, (name, colours, what) in enumerate(panels):
            ends = [(np.nanmin(view.values[name]), np.nanmax(view.values[name])) for view in views]
            norm = Normalize(min(low for low, _ in ends), max(high for _, high in ends))
            for axis, view, stenosis in zip(axes[:, column], views, stenoses, strict=True):
                axis.pcolormesh(
                    view.along, view.across, view.values[name], cmap=colours, norm=norm, shading="nearest",
                    rasterized=True,
                )  # fmt: skip
                _mark(axis, view, stenosis.name)
            axes[-1, column].set_xlabel("distance from the throat along the artery (cm)")
            bar = figure.colorbar(ScalarMappable(norm, colours), ax=list(axes[:, column]), aspect=24, shrink=0.8)
            bar.set_label(what)
            bar.outline.set_visible(False)


def _mark(axis, view: Straightened, name: str) -> None:
    """Name the artery, and mark its throat and the plane at which FFR is read."""
    axis.set_aspect(STRETCH)
    axis.set_facecolor("none")
    axis.set_title(name, loc="left", color=colour(name))
    top = view.across[-1]
    axis.plot(0.0, top, "v", color="black", ms=5, clip_on=False)
    axis.plot(view.lesion, [-top, -top], color="black", lw=2.5, solid_capstyle="butt", clip_on=False)
    if view.read is not None:
        axis.axvline(view.read, color="black", lw=1.0, ls=(0, (3, 2)))
        axis.annotate("FFR", (view.read, top), (0, 2), textcoords="offset points", ha="center", fontsize=8)
    axis.set_yticks([-0.2, 0.2] if top > 0.2 else [])
    axis.set_ylabel("across (cm)", fontsize=8)
    axis.tick_params(labelsize=8)
    for side in ("left", "bottom"):
        axis.spines[side].set_visible(False)


def straightened(inside: pv.DataSet, tree: Tree, stenosis: Stenosis, planes: Mapping[str, Plane]) -> Straightened:
    """Return the lumen around a stenosis, straightened.

    Points of the view lie on normals of the centreline that turn with it as little as they can.

    Parameters
    ----------
    inside
        The 3D field, with `speed` and `mmHg`.
    tree, stenosis
        The centreline tree, and the stenosis.
    planes
        Planes of FFR by stenosis.
    """
    plane = planes.get(stenosis.name)
    course, before = _course(tree, stenosis, plane)
    place, _ = throat(tree, stenosis)
    read = None if plane is None else plane.distance_from_throat
    end = max(stenosis.end - place, read or 0.0) + BEHIND
    low, high = max(0.0, before + stenosis.start - BEFORE), min(course.length, before + place + end)
    arc = np.arange(low, high, FINE)
    points = course.position_at(arc)
    aside = _normals(points)
    width = WIDE * float(course.radius_at(arc).max())
    across = np.arange(-width, width + FINE, FINE)
    grid = points[None] + across[:, None, None] * aside[None]
    found = pv.PolyData(grid.reshape(-1, 3)).sample(inside)
    outside = ~np.asarray(found["vtkValidPointMask"], bool)
    values = {name: np.where(outside, np.nan, found[name]).reshape(len(across), len(arc)) for name in ("speed", "mmHg")}
    seen = np.isfinite(values["mmHg"]).any(axis=0)
    values = {name: value[:, seen] for name, value in values.items()}
    lesion = (stenosis.start - place, stenosis.end - place)
    return Straightened((arc - before - place)[seen], across, values, lesion, read)


def _course(tree: Tree, stenosis: Stenosis, plane: Plane | None) -> tuple[Vessel, float]:
    """Return the artery through a stenosis as one vessel, and the arc length (cm) at which its own vessel starts.

    Beyond the stenosis it leads to the plane of FFR, or else along the wider children.
    """
    upstream = [vessel for vessel in tree.path(stenosis.vessel) if vessel.branch != AORTA]
    before = sum(vessel.length for vessel in upstream[:-1])
    course = list(upstream)
    wanted = {vessel.name for vessel in tree.path(plane.vessel)} if plane and plane.vessel in tree else set()
    while children := tree.children(course[-1].name):
        course.append(max(children, key=lambda child: (child.name in wanted, float(child.radii.mean()), child.name)))
    points = np.concatenate([course[0].points, *(vessel.points[1:] for vessel in course[1:])])
    radii = np.concatenate([course[0].radii, *(vessel.radii[1:] for vessel in course[1:])])
    return Vessel("course", points, radii, None, stenosis.name), before


def _normals(points: np.ndarray) -> np.ndarray:
    """Return unit normals (n, 3) of a curve that do not turn about it, in its best plane where it begins."""
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    normal = np.linalg.svd(points - points.mean(axis=0))[2][2]
    aside = np.cross(normal, along[0])
    normals = []
    for tangent in along:
        aside = aside - (aside @ tangent) * tangent
        aside = aside / np.linalg.norm(aside)
        normals.append(aside)
    return np.array(normals)
