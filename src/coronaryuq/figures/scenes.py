"""Three-dimensional pictures, drawn off screen: territories and perfusion, the tree by FFR, vessel walls and lumens."""

import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyvista as pv

from coronaryuq.case.tree import Tree, read_tree
from coronaryuq.errors import InputError
from coronaryuq.figures.style import BRANCHES
from coronaryuq.files import read_csv, read_json, replacing
from coronaryuq.units import MBF_PER_MIN_PER_G, MMHG

VIEW = (0.65, -1.0, 0.2)
"""Where the heart is seen from, in left-posterior-superior axes: from in front and its left, a little above."""
BEHIND = (0.1, 0.75, -0.65)
"""From behind and below: the territories of the right coronary and circumflex arteries."""

BAR = {"vertical": True, "position_x": 0.86, "position_y": 0.2, "height": 0.6, "width": 0.06, "fmt": "%.2f",
       "title_font_size": 15, "label_font_size": 13, "n_labels": 5, "color": "black"}  # fmt: skip


def territories(case: str, lv: str, tree: str, output: str) -> None:
    """Myocardial blood flow, and the territory of each LV-perfusing outlet from in front and from behind."""
    outlets = [outlet for outlet in read_json(case)["outlets"] if outlet["perfuses"] == "LV"]
    wall, vessels = pv.read(lv), read_tree(tree)
    centres = wall.cell_centers().points
    nearest = np.argmin([np.linalg.norm(centres - np.array(o["point"]), axis=1) for o in outlets], axis=0)
    wall.cell_data["mL/min/g"] = wall.cell_data["MBF"] / MBF_PER_MIN_PER_G
    wall.cell_data["territory"] = nearest
    surface = wall.extract_surface(algorithm="dataset_surface")
    with _picture(output, columns=3, views=(VIEW, VIEW, BEHIND)) as plotter:
        plotter.add_mesh(surface, scalars="mL/min/g", cmap="viridis", scalar_bar_args=BAR)
        _add_tree(plotter, vessels, color="#B22222")
        plotter.add_text("Myocardial blood flow", font_size=10, color="black")
        for column, view, where in ((1, VIEW, "in front"), (2, BEHIND, "behind and below")):
            plotter.subplot(0, column)
            plotter.add_mesh(surface.copy(), scalars="territory", cmap=_shades(outlets), show_scalar_bar=False)
            _add_tree(plotter, vessels, color="#444444")
            facing = [o for o in outlets if (np.array(o["point"]) - centres.mean(axis=0)) @ np.array(view) > 0.5]
            points, labels = [o["point"] for o in facing], [o.get("label") or o["name"] for o in facing]
            plotter.add_point_labels(
                np.array(points), labels, font_size=13, shape_opacity=0.75, show_points=False, always_visible=True,
                text_color="black", shape_color="white",
            )  # fmt: skip
            plotter.add_text(f"Perfusion territories, from {where}", font_size=10, color="black")


def tree_by_ffr(case: str, tree: str, pressures: str, output: str) -> None:
    """The tree coloured by mean pressure over mean aortic pressure; `pressures`: vessel, position (0 to 1), ffr."""
    vessels, table = read_tree(tree), read_csv(pressures, columns=("vessel", "position", "ffr"))
    with _picture(output) as plotter:
        for vessel in vessels:
            along = table[table["vessel"] == vessel.name].sort_values("position")
            if along.empty:
                continue
            values = np.interp(vessel.arc / vessel.length, along["position"], along["ffr"])
            plotter.add_mesh(
                _tube(vessel.points, vessel.radii, values), scalars="value", cmap="RdYlBu", clim=(0.6, 1.0),
                scalar_bar_args=BAR | {"title": "FFR"},
            )  # fmt: skip
        _label_stenoses(plotter, read_json(case), vessels)
        plotter.add_text("Fractional flow reserve, 0D, posterior mean", font_size=10, color="black")


def walls(fields: str, case: str, tree: str, output: str) -> None:
    """The 3D vessel walls of the first sample, by piece: time-averaged wall shear stress and oscillatory shear index.

    fields: the archive of a batch's fields. Stress is on a logarithmic scale, since the throat's is a hundred times
    that of the region behind it, where the quantities of interest lie.
    """
    wall = _first(fields, "_wall.vtp")
    vessels, stenoses = read_tree(tree), read_json(case)["stenoses"]
    pieces = [piece.extract_surface(algorithm="dataset_surface") for piece in wall.connectivity().split_bodies()]
    highest = float(np.quantile(wall["TAWSS"], 0.999))
    panels = (
        (
            "TAWSS",
            {"cmap": "turbo", "clim": (5.0, highest), "log_scale": True},
            {"title": "TAWSS dyn/cm2", "fmt": "%.0f"},
        ),
        ("OSI", {"cmap": "YlOrRd", "clim": (0.0, 0.5)}, {"title": "OSI", "fmt": "%.2f"}),
    )
    with _picture(output, rows=2, columns=len(pieces)) as plotter:
        for row, (name, look, bar) in enumerate(panels):
            for column, piece in enumerate(pieces):
                plotter.subplot(row, column)
                shown = piece.copy()
                shown[name] = np.maximum(shown[name], look["clim"][0])
                plotter.add_mesh(
                    shown, scalars=name, ambient=0.6, diffuse=0.5, show_scalar_bar=column == len(pieces) - 1,
                    scalar_bar_args=BAR | bar, **look,
                )  # fmt: skip
                _label_stenoses(plotter, {"stenoses": _within(piece, stenoses, vessels)}, vessels)
        plotter.subplot(0, 0)
        plotter.add_text("Wall shear of the first 3D sample", font_size=10, color="black")


def lumen(fields: str, case: str, tree: str, output: str, reach: float = 1.6, height: float = 1.0) -> None:
    """Speed and pressure of the first sample, means over a cycle, in a plane along each stenosis, blood from the left.

    The plane is the one that the centreline around the stenosis leaves least. reach: length shown either side of the
    stenosis' middle, cm; height: of a panel, cm, the same for all.
    """
    inside = _first(fields, ".vtu")
    inside["speed"] = np.linalg.norm(inside["mean_velocity"], axis=1)
    inside["mmHg"] = inside["mean_pressure"] / MMHG
    vessels, stenoses = read_tree(tree), read_json(case)["stenoses"]
    cuts = [_cut(inside, vessels[stenosis["vessel"]], stenosis, reach) for stenosis in stenoses]
    panels = (("speed", "turbo", "cm/s", "mean speed"), ("mmHg", "viridis", "mmHg", "mean pressure"))
    with _picture(output, rows=len(cuts), columns=2, views=(), panel=(900, 240)) as plotter:
        for column, (name, colours, unit, what) in enumerate(panels):
            limits = [f(f(cut[name]) for cut, *_ in cuts) for f in (min, max)]
            for row, (cut, middle, normal, along) in enumerate(cuts):
                plotter.subplot(row, column)
                plotter.add_mesh(
                    cut.copy(), scalars=name, cmap=colours, clim=limits, lighting=False,
                    scalar_bar_args=BAR | {"title": unit, "fmt": "%.0f", "n_labels": 3, "position_x": 0.93},
                )  # fmt: skip
                plotter.add_text(f"{stenoses[row]['name']}, {what}", position="lower_right", font_size=9, color="black")
                plotter.enable_parallel_projection()
                focus = middle + 0.17 * along
                plotter.camera_position = [focus + 5.0 * normal, focus, np.cross(normal, along)]
                plotter.camera.parallel_scale = height / 2.0


def _cut(inside: pv.UnstructuredGrid, vessel, stenosis: dict, reach: float) -> tuple:
    """A stenosis cut along its centreline: the cut, its middle, the plane's normal, and the direction of flow."""
    near = (vessel.arc > stenosis["start"] - 0.5) & (vessel.arc < stenosis["end"] + 1.0)
    points = vessel.points[near]
    normal = np.linalg.svd(points - points.mean(axis=0))[2][2]
    along = points[-1] - points[0] - ((points[-1] - points[0]) @ normal) * normal
    along /= np.linalg.norm(along)
    middle = vessel.position_at(0.5 * (stenosis["start"] + stenosis["end"]))
    cut = inside.slice(normal=normal, origin=middle).connectivity("closest", closest_point=middle)
    for end in (-1.0, 1.0):
        cut = cut.clip(normal=end * along, origin=middle + end * reach * along)
    return cut, middle, normal, along


def _first(fields: str, ending: str) -> pv.DataSet:
    """The first sample's file of that ending in an archive of fields."""
    with zipfile.ZipFile(fields) as archive, tempfile.TemporaryDirectory() as folder:
        names = sorted(name for name in archive.namelist() if name.endswith(ending))
        if not names:
            raise InputError(fields, None, None, "holds no fields; keep those of one sample at least (flow3d.fields)")
        path = Path(folder, f"field{ending}")
        path.write_bytes(archive.read(names[0]))
        return pv.read(path)


def _within(piece: pv.PolyData, stenoses: list[dict], tree: Tree) -> list[dict]:
    """The stenoses whose middle lies inside the piece's bounding box."""
    low, high = np.asarray(piece.bounds).reshape(3, 2).T
    places = {s["name"]: tree[s["vessel"]].position_at(0.5 * (s["start"] + s["end"])) for s in stenoses}
    return [s for s in stenoses if (places[s["name"]] > low).all() and (places[s["name"]] < high).all()]


@contextmanager
def _picture(
    output: str, rows: int = 1, columns: int = 1, views=(VIEW,), panel: tuple[int, int] = (600, 560)
) -> Iterator[pv.Plotter]:
    """A plotter whose picture is written to `output` at the end; `views`: where each column is seen from, the last for
    all that follow; none where the caller places every camera.
    """
    plotter = pv.Plotter(
        off_screen=True, shape=(rows, columns), window_size=(panel[0] * columns, panel[1] * rows), border=False
    )
    plotter.set_background("white")
    try:
        yield plotter
        for row, column in np.ndindex(rows, columns) if views else ():
            plotter.subplot(row, column)
            plotter.view_vector(views[min(column, len(views) - 1)], viewup=(0, 0, 1))
            plotter.camera.zoom(1.25)
        with replacing(output) as beside:
            plotter.screenshot(str(beside))
    finally:
        plotter.close()


def _add_tree(plotter: pv.Plotter, tree: Tree, **look) -> None:
    for vessel in tree:
        plotter.add_mesh(_tube(vessel.points, vessel.radii), **look)


def _tube(points: np.ndarray, radii: np.ndarray, values: np.ndarray | None = None) -> pv.PolyData:
    line = pv.lines_from_points(points)
    line["radius"] = radii
    if values is not None:
        line["value"] = values
    return line.tube(scalars="radius", absolute=True, n_sides=16)


def _label_stenoses(plotter: pv.Plotter, case: dict, tree: Tree) -> None:
    names = {vessel.name for vessel in tree}
    known = [s for s in case["stenoses"] if s["vessel"] in names]
    middles = [tree[s["vessel"]].position_at(0.5 * (s["start"] + s["end"])) for s in known]
    plotter.add_point_labels(
        np.array(middles), [s["name"] for s in known], font_size=15, bold=True, show_points=False, always_visible=True,
        shape_color="white", shape_opacity=0.8, text_color="black",
    )  # fmt: skip


def _shades(outlets: list[dict]) -> list[str]:
    """A shade of its branch's colour for every outlet, so that neighbours differ and branches are recognised."""
    from matplotlib.colors import to_hex, to_rgb

    shades, seen = [], {}
    for outlet in outlets:
        number = seen[outlet["branch"]] = seen.get(outlet["branch"], -1) + 1
        total = sum(other["branch"] == outlet["branch"] for other in outlets)
        base = np.array(to_rgb(BRANCHES.get(outlet["branch"], "#777777")))
        shades.append(to_hex(base + (1 - base) * 0.75 * ((number * 3) % max(total, 1)) / max(total, 1)))
    return shades
