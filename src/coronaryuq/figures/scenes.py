"""Three-dimensional views: territories and perfusion, FFR along the tree, vessel walls and lumens."""

import tempfile
import zipfile
from pathlib import Path

import matplotlib
import numpy as np
import pyvista as pv
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LogNorm, Normalize, to_hex, to_rgb
from matplotlib.patheffects import withStroke

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel, placed_stenoses, read_tree
from coronaryuq.case.case_json import CaseOutlet, read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.io.vtk import read_vtk
from coronaryuq.core.units import MBF_PER_MIN_PER_G
from coronaryuq.figures.render import Camera, Item, Rendering, rendered
from coronaryuq.figures.style import BRANCHES, DARK, FFR_COLOURS, FFR_LIMIT, FFR_RANGE, Output, colour, ffr_map, saved

FRONT = Camera((0.65, -1.0, 0.2))
"""From the front, slightly from the left and above, in left-posterior-superior axes."""
BACK = Camera((0.1, 0.75, -0.65))
"""From behind and below: the territories of the right coronary and circumflex arteries."""

GHOST = {"color": "#9AA0A6", "opacity": 0.3}
"""Of the aorta, which has no FFR and is often made, not measured."""
CUFF = 0.035
"""Half the length (cm) of the dark edge at the limit of FFR."""

EDGE = [withStroke(linewidth=2.2, foreground="white")]
BOX = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}


def territories(case: str, lv: str, tree: str, output: Output) -> None:
    """Draw myocardial blood flow, and the territory of each LV-perfusing outlet from the front and from behind.

    Without a perfusion map there is no wall: the outlets alone are drawn.
    """
    outlets = read_case(case).lv_outlets
    wall, vessels = read_vtk(lv), read_tree(tree)
    if not is_wall(wall):
        _outlets_alone(outlets, vessels, output)
        return
    ends = np.array([outlet.point for outlet in outlets])
    labels = [outlet.label for outlet in outlets]
    centres = wall.cell_centers().points
    wall.cell_data["flow"] = wall.cell_data["MBF"] / MBF_PER_MIN_PER_G
    wall.cell_data["territory"] = np.argmin([np.linalg.norm(centres - end, axis=1) for end in ends], axis=0)
    surface = wall.extract_surface(algorithm="dataset_surface")
    norm = Normalize(float(np.min(wall.cell_data["flow"])), float(np.max(wall.cell_data["flow"])))
    flow = {"scalars": "flow", "cmap": "viridis", "clim": (norm.vmin, norm.vmax)}
    shares = {"scalars": "territory", "cmap": shades(outlets), "clim": (-0.5, len(outlets) - 0.5)}
    pictures = [rendered([(surface.copy(), flow), *_tubes(vessels, "#444444")], FRONT)]
    shown = []
    for camera in (FRONT, BACK):
        facing = (ends - centres.mean(axis=0)) @ np.array(camera.view) > 0.5
        shown.append([label for label, faces in zip(labels, facing, strict=True) if faces])
        items = [(surface.copy(), shares), *_tubes(vessels, "#444444")]
        pictures.append(rendered(items, camera, marks=ends[facing]))
    titles = ("Myocardial blood flow", "Perfusion territories, front view", "from behind and below")
    with _row(output, pictures) as (figure, axes):
        for axis, picture, title in zip(axes, pictures, titles, strict=True):
            _show(axis, picture, title)
        for axis, picture, names in zip(axes[1:], pictures[1:], shown, strict=True):
            for place, name in zip(picture.places, names, strict=True):
                axis.annotate(name, place, ha="center", va="center", fontsize=6.5, bbox=BOX)
        _scale(figure, axes[0], norm, "viridis", "mL/min/g")


def is_wall(wall: pv.DataSet) -> bool:
    """Return whether the cells of `lv.vtu` are those of a perfusion map, not one point per territory."""
    return set(np.unique(wall.celltypes)) != {pv.CellType.VERTEX}


def _outlets_alone(outlets: list[CaseOutlet], vessels: Tree, output: Output) -> None:
    balls = [(pv.Sphere(radius=0.28, center=outlet.point), {"color": colour(outlet.branch)}) for outlet in outlets]
    ends = np.array([outlet.point for outlet in outlets])
    pictures = [rendered([*balls, *_tubes(vessels, "#444444")], camera, marks=ends) for camera in (FRONT, BACK)]
    with _row(output, pictures) as (_, axes):
        titles = ("Outlets with measured flows, front view", "from behind and below")
        for axis, picture, title in zip(axes, pictures, titles, strict=True):
            _show(axis, picture, title)
            for place, outlet in zip(picture.places, outlets, strict=True):
                axis.annotate(outlet.label, place, xytext=(0, 8), textcoords="offset points", ha="center", fontsize=6.5)


def tree_by_ffr(case: str, tree: str, pressures: str, output: Output) -> None:
    """Draw the coronary tree coloured by FFR, median over the posterior, with a dark edge at the limit.

    Lesions and the places of a pressure wire are named. The aorta, which has no FFR, is a ghost. pressures: table of
    vessel, position (0 to 1), ffr.
    """
    vessels, table = read_tree(tree), read_csv(pressures, columns=("vessel", "position", "ffr"))
    norm = Normalize(*FFR_RANGE)
    items: list[Item] = []
    for vessel in vessels:
        along = table[table["vessel"] == vessel.name].sort_values("position")
        if vessel.branch == AORTA:
            items.append((_tube(vessel.points, vessel.radii), GHOST))
        elif not along.empty:
            values = np.interp(vessel.arc / vessel.length, along["position"], along["ffr"])
            look = {"scalars": "value", "cmap": FFR_COLOURS, "clim": FFR_RANGE}
            items.append((_tube(vessel.points, vessel.radii, values), look))
            items += [(_tube(*edge), {"color": DARK}) for edge in limit_edges(vessel, values)]
    summary = read_case(case)
    names, marks = _stenoses(placed_stenoses(summary.stenoses), vessels)
    names += [f"wire: {wire.name}" for wire in summary.ffr_at]
    marks = np.array([*marks, *(vessels[wire.vessel].position_at(wire.arc) for wire in summary.ffr_at)]).reshape(-1, 3)
    pictures = [rendered(items, camera, marks) for camera in (FRONT, BACK)]
    with _row(output, pictures) as (figure, axes):
        for axis, picture, title in zip(axes, pictures, ("front view", "from behind and below"), strict=True):
            _show(axis, picture, title)
            _point_out(axis, picture, names)
        _scale(figure, axes, norm, ffr_map(), "FFR (0D, median)")


def walls(fields: str, case: str, tree: str, output: Output) -> None:
    """Draw time-averaged wall shear stress and oscillatory shear index of the first 3D sample, by piece of the domain.

    fields: archive of a batch's fields. The stress has a logarithmic scale: in the throat it is a hundred times that in
    the region distal to it, where the quantities of interest are evaluated.
    """
    wall = first_field(fields, "_wall.vtp")
    vessels, stenoses = read_tree(tree), placed_stenoses(read_case(case).stenoses)
    pieces = [piece.extract_surface(algorithm="dataset_surface") for piece in wall.connectivity().split_bodies()]
    panels = (
        ("TAWSS", "viridis", LogNorm(5.0, float(np.quantile(wall["TAWSS"], 0.999))), "TAWSS (dyn/cm²)"),
        ("OSI", "magma_r", Normalize(0.0, 0.5), "OSI"),
    )
    marked = [_stenoses(_within(piece, stenoses, vessels), vessels) for piece in pieces]
    pictures = [
        [_wall(piece, name, colours, norm, marks) for piece, (_, marks) in zip(pieces, marked, strict=True)]
        for name, colours, norm, _ in panels
    ]
    widths = [picture.aspect for picture in pictures[0]]
    size = (min(9.0, 5.8 * sum(widths) + 1.6), 3.0)
    with saved(
        output, ncols=2 * len(pieces), figsize=size, squeeze=False, width_ratios=2 * widths, layout="compressed"
    ) as (figure, axes):
        halves = (axes[0][: len(pieces)], axes[0][len(pieces) :])
        for row, shown, (_, colours, norm, label) in zip(halves, pictures, panels, strict=True):
            for axis, picture, (names, _) in zip(row, shown, marked, strict=True):
                _show(axis, picture)
                _point_out(axis, picture, names)
            _scale(figure, row, norm, colours, label)


def _wall(piece: pv.PolyData, name: str, colours: str, norm: Normalize, marks: np.ndarray) -> Rendering:
    shown = piece.copy()
    shown[name] = np.maximum(shown[name], norm.vmin or 0.0)
    look = {
        "scalars": name, "cmap": colours, "clim": (norm.vmin, norm.vmax), "log_scale": isinstance(norm, LogNorm),
    }  # fmt: skip
    return rendered([(shown, look)], FRONT, marks)


def first_field(fields: str, ending: str) -> pv.DataSet:
    """Return the first sample's field whose file name has an ending, from an archive of fields."""
    with zipfile.ZipFile(fields) as archive, tempfile.TemporaryDirectory() as folder:
        names = sorted(name for name in archive.namelist() if name.endswith(ending))
        if not names:
            raise InputError(
                fields, None, None, "contains no fields; keep those of at least one sample (setting flow3d.fields)"
            )
        path = Path(folder, f"field{ending}")
        path.write_bytes(archive.read(names[0]))
        return read_vtk(path)


def _within(piece: pv.PolyData, stenoses: list[Stenosis], tree: Tree) -> list[Stenosis]:
    """Return the stenoses whose middle lies in the bounding box of a piece."""
    low, high = np.asarray(piece.bounds).reshape(3, 2).T
    places = {s.name: tree[s.vessel].position_at(0.5 * (s.start + s.end)) for s in stenoses}
    return [s for s in stenoses if (places[s.name] > low).all() and (places[s.name] < high).all()]


def _row(output: Output, pictures: list[Rendering]):
    """Open a figure with images side by side, of equal height."""
    widths = [picture.aspect for picture in pictures]
    size = (8.6, min(8.6 / (sum(widths) + 0.35) + 0.3, 6.0))
    return saved(output, ncols=len(pictures), figsize=size, width_ratios=widths, layout="compressed")


def _show(axis, picture: Rendering, title: str | None = None) -> None:
    axis.imshow(picture.image, interpolation="antialiased")
    axis.set_axis_off()
    if title:
        axis.set_title(title, loc="left")


def _point_out(axis, picture: Rendering, names: list[str]) -> None:
    """Label marked points, with the labels away from the middle of the image and a line to each point."""
    height, width = picture.image.shape[:2]
    for name, place in zip(names, picture.places, strict=True):
        away = np.array([1.0 if place[0] > 0.5 * width else -1.0, 0.45 if place[1] < 0.5 * height else -0.45])
        axis.annotate(
            name, place, xytext=26 * away, textcoords="offset points", ha="center", va="center", fontsize=8,
            fontweight="bold", bbox=BOX, annotation_clip=False,
            arrowprops={"arrowstyle": "-", "lw": 0.8, "shrinkA": 0, "shrinkB": 0, "path_effects": EDGE},
        )  # fmt: skip


def _scale(figure, axes, norm: Normalize, colours: str | Colormap, label: str) -> None:
    colour_map = colours if isinstance(colours, Colormap) else matplotlib.colormaps[colours]
    bar = figure.colorbar(ScalarMappable(norm, colour_map), ax=axes, shrink=0.8, aspect=24, pad=0.02)
    bar.set_label(label)
    if isinstance(norm, LogNorm):
        bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.outline.set_visible(False)


def limit_edges(vessel: Vessel, values: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return centreline and radii of a short cuff wherever FFR (n,), at the vessel's points, crosses its limit."""
    below = np.flatnonzero((values[:-1] > FFR_LIMIT) != (values[1:] > FFR_LIMIT))
    share = (FFR_LIMIT - values[below]) / (values[below + 1] - values[below])
    places = vessel.arc[below] + share * np.diff(vessel.arc)[below]
    cuffs = []
    for arc in places:
        ends = np.clip([arc - CUFF, arc + CUFF], 0.0, vessel.length)
        cuffs.append((vessel.position_at(ends), 1.12 * vessel.radius_at(ends)))
    return cuffs


def _tubes(tree: Tree, colour: str) -> list:
    looks = {AORTA: GHOST}
    return [(_tube(vessel.points, vessel.radii), looks.get(vessel.branch, {"color": colour})) for vessel in tree]


def _tube(points: np.ndarray, radii: np.ndarray, values: np.ndarray | None = None) -> pv.PolyData:
    line = pv.PolyData(points, lines=np.concatenate([[len(points)], np.arange(len(points))]))
    line["radius"] = radii
    if values is not None:
        line["value"] = values
    return line.tube(scalars="radius", absolute=True, n_sides=16)


def _stenoses(stenoses: list[Stenosis], tree: Tree) -> tuple[list[str], np.ndarray]:
    """Return names and middles (n, 3) of the stenoses in vessels of the tree."""
    names = {vessel.name for vessel in tree}
    known = [stenosis for stenosis in stenoses if stenosis.vessel in names]
    middles = [tree[s.vessel].position_at(0.5 * (s.start + s.end)) for s in known]
    return [stenosis.name for stenosis in known], np.array(middles).reshape(-1, 3)


def shades(outlets: list[CaseOutlet]) -> list[str]:
    """Return a shade of its branch's colour for each outlet, such that neighbours differ."""
    shades: list[str] = []
    seen: dict[str, int] = {}
    for outlet in outlets:
        number = seen[outlet.branch] = seen.get(outlet.branch, -1) + 1
        total = sum(other.branch == outlet.branch for other in outlets)
        base = np.array(to_rgb(BRANCHES.get(outlet.branch, "#777777")))
        red, green, blue = base + (1 - base) * 0.75 * ((number * 3) % max(total, 1)) / max(total, 1)
        shades.append(to_hex((red, green, blue)))
    return shades
