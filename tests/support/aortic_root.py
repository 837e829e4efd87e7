"""A case from public data: a real aortic root with coronary arteries, an atlas ventricle, a synthetic perfusion map."""

from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.centrelines import centreline_tree
from coronaryuq.case.anatomy.read import labelled
from coronaryuq.case.anatomy.stenosis_detection import detected_stenoses
from coronaryuq.case.anatomy.surface import read_surface
from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.core import seeds
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.core.units import MM
from support.ventricle_atlas import atlas_wall, read_atlas, register_to_arteries

OUTLETS = (
    ("lca1", "LAD", "LV", "LAD", (70.62, 100.53, 117.61)),
    ("lca2", "D1", "LV", "LAD", (77.62, 103.78, 116.52)),
    ("lca3", "D2", "LV", "LAD", (77.41, 102.60, 114.79)),
    ("lca4", "LCx", "LV", "LCx", (78.43, 109.52, 110.31)),
    ("rca1", "PDA", "LV", "RCA", (69.81, 102.23, 115.71)),
    ("rca2", "PL", "LV", "RCA", (71.42, 106.59, 111.58)),
    ("rca3", "AM", "RV", "RCA", (71.24, 99.05, 110.46)),
)
"""Name, label, what it perfuses, branch and the centre of its cap in `coronarytree.stl`, cm: read off the courses."""
INLET = (76.47, 105.96, 111.20)
PERFUSION = 2.0
"""mL/min/g of the healthy wall under hyperaemia."""
ANY = 1.0
"""The anatomy has no severe stenosis: the narrowest place of each artery is taken, however mild."""
DEFICIT = 0.8
"""Behind a stenosis, relative to that."""
TARGETS = """\
PaoMin: {value: 72, unit: mmHg}
PaoMax: {value: 122, unit: mmHg}
PaoMean: {value: 92, unit: mmHg}
AbsQin: {value: 75, unit: mL}
EFLV: {value: 0.62}
ESV: {value: 46, unit: mL}
EDV: {value: 121, unit: mL}
AorCorSplit: {value: 4.0, unit: "%"}
PpulMean: {value: 14, unit: mmHg}
Qsystole_perc: {value: 0.9}
LCorMaxRatio: {value: 2.4}
LCorTotRatio: {value: 4.667}
LThirdFF: {value: 0.46}
LHalfFF: {value: 0.67}
RCorMaxRatio: {value: 1.4}
RCorTotRatio: {value: 1.2857}
RThirdFF: {value: 0.39}
RHalfFF: {value: 0.57}
"""
"""An adult at rest with normal pressures; the waveform targets are the population averages of closed-loop-22."""


def write_aortic_root_case(
    shared: str | Path, out: str | Path, seed: int = 1, surface_spacing: float | None = None
) -> Path:
    """Write `case.yaml` and its files to `out`; return the path of `case.yaml`.

    shared: folder with data/anatomy-aortic-root-7 and data/lv-atlas. The surface is written again as STL, the wall of
    the atlas registered to its arteries, with a map that is lower behind the stenoses and has a smooth texture.
    """
    out, data = Path(out), Path(shared) / "data"
    surface = read_surface(data / "anatomy-aortic-root-7" / "coronarytree.stl")

    def cap_at(place):
        return min(surface.caps, key=lambda cap: float(np.linalg.norm(cap.centre - place)))

    inlet = cap_at(INLET)
    ends = {name: cap_at(place) for name, _, _, _, place in OUTLETS}
    ends["aorta_outlet"] = surface.caps[0] if surface.caps[1] is inlet else surface.caps[1]
    tree = labelled(
        centreline_tree(out, surface, inlet, ends, surface_spacing), {o[0]: o[3] for o in OUTLETS}
    )  # fmt: skip
    write_vtk(out / "lumen.stl", surface.polydata())
    write_vtk(out / "lv.vtu", _perfused_wall(data / "lv-atlas" / "LV_ED_mean.vtk", tree, seed))
    write_text(
        out / "outlets.csv",
        "name,x,y,z,perfuses,branch,label\n"
        + "".join(f"{n},{x},{y},{z},{p},{b},{label}\n" for n, label, p, b, (x, y, z) in OUTLETS),
    )
    write_text(out / "targets.yaml", TARGETS)
    stenoses = "".join(_stenosis_line(tree, s) for s in detected_stenoses(tree, ANY, 0.0, {}))
    write_text(
        out / "case.yaml",
        "name: aortic-root-7\n"
        "description: real aortic root and coronary arteries, atlas ventricle, synthetic perfusion and targets\n"
        f"anatomy: {{surface: lumen.stl, unit: cm, inlet: {list(INLET)}}}\n"
        "perfusion: {file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: cm}\n"
        f"outlets: outlets.csv\nstenoses:\n{stenoses}targets: targets.yaml\nperiod: 0.9\n",
    )
    return out / "case.yaml"


def _stenosis_line(tree: Tree, stenosis) -> str:
    """By its throat, so that the case does not depend on how vessels are numbered."""
    part = tree[stenosis.vessel].between(stenosis.start, stenosis.end)
    x, y, z = np.round(part.points[np.argmin(part.radii)], 3).tolist()
    return f"  - {{name: {stenosis.name}, point: [{x}, {y}, {z}]}}\n"


def _perfused_wall(path: Path, tree: Tree, seed: int):
    atlas = read_atlas(path, MM)
    wall = atlas_wall(atlas)
    laid = [v.name for v in tree if v.branch in ("LAD", "LCx")]
    laid += [name for name, _, perfuses, branch, _ in OUTLETS if branch == "RCA" and perfuses == "LV"]
    matrix = register_to_arteries(atlas, tree, laid, ["lca1", "rca1"])
    wall.points = np.asarray(wall.points, dtype=float) @ matrix[:3, :3].T + matrix[:3, 3]
    centres = np.asarray(wall.cell_centers().points, dtype=float)
    feeding = [o for o in OUTLETS if o[2] == "LV"]
    ends = np.array([tree[o[0]].points[-1] for o in feeding])
    behind = {v.name for s in detected_stenoses(tree, ANY, 0.0, {}) for v in tree.subtree(s.vessel)}
    level = np.array([DEFICIT if o[0] in behind else 1.0 for o in feeding])
    distance = np.linalg.norm(centres[:, None] - ends, axis=2)
    mix = np.exp(-(distance - distance.min(axis=1, keepdims=True)) / 0.3)
    random = seeds.generator(seed, "aortic root", "texture")
    wave, phase = random.normal(0, 1 / 1.5, (64, 3)), random.uniform(0, 2 * np.pi, 64)
    texture = np.exp(0.1 * np.sqrt(2 / 64) * np.cos(centres @ wave.T + phase).sum(axis=1))
    wall.clear_data()
    wall.cell_data["MBF"] = PERFUSION * texture * (mix @ level) / mix.sum(axis=1)
    return wall
