"""Vessels and a small case on disk, to try things on."""

from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, Vessel, write_tree


def straight(name, start, direction, length, radii, parent=None, branch="aorta", points=21):
    """A straight vessel with radii linear from first to last."""
    share = np.linspace(0, 1, points)
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    return Vessel(
        name,
        np.asarray(start, float) + share[:, None] * length * direction,
        radii[0] + share * (radii[1] - radii[0]),
        parent,
        branch,
    )


def small_tree(**points: int) -> Tree:
    """An aorta with a left main that divides once, and a right coronary artery; lengths are round numbers.

    points: of a vessel, where it needs other than 21.
    """
    vessels = (
        ("aorta", (0, 0, 0), (0, 0, 1), 2.0, (1.2, 1.2)),
        ("branch1", (0, 0, 2), (1, 0, 0), 3.2, (0.2, 0.2), "aorta", "LM"),
        ("lca1", (3.2, 0, 2), (1, 0, -1), 4.0, (0.16, 0.12), "branch1", "LAD"),
        ("lca2", (3.2, 0, 2), (1, 1, 0), 3.0, (0.15, 0.10), "branch1", "LCx"),
        ("rca1", (0, 0, 2), (-1, 0, 0), 6.2, (0.18, 0.12), "aorta", "RCA"),
        ("aorta_outlet", (0, 0, 2), (0, 0, 1), 3.0, (1.2, 1.2), "aorta"),
    )
    return Tree([straight(*vessel, points=points.get(vessel[0], 21)) for vessel in vessels])


def write_case(folder: Path, tree: Tree, **changes: str) -> Path:
    """Write a sound case of `small_tree` and return its `case.yaml`; `changes` replace or add (None removes) lines."""
    import pyvista as pv

    folder.mkdir(parents=True, exist_ok=True)
    write_tree(folder / "tree.vtp", tree)
    ball = pv.ImageData(dimensions=(17, 17, 17), spacing=(0.5,) * 3, origin=(-4, -4, -8)).cast_to_unstructured_grid()
    radius = np.linalg.norm(ball.cell_centers().points - [0, 0, -4], axis=1)
    wall = ball.extract_cells(np.flatnonzero((radius < 3.4) & (radius > 2.4)))
    wall.clear_data()
    wall.cell_data["MBF"] = np.full(wall.n_cells, 2.0)
    wall.save(folder / "lv.vtu")
    (folder / "outlets.csv").write_text(
        "name,vessel,perfuses,branch\nlca1,lca1,LV,LAD\nlca2,lca2,LV,LCx\nrca1,rca1,LV,RCA\n"
    )
    (folder / "targets.csv").write_text("PaoMean,Mean Aortic Pressure,90\nAbsQin,Stroke Volume,70\nQlaRatio,E/A,none\n")
    lines = {
        "name": "small",
        "anatomy": "{centrelines: tree.vtp, unit: cm}",
        "perfusion": "{file: lv.vtu, array: MBF, unit: mL/min/g, length_unit: cm}",
        "outlets": "outlets.csv",
        "stenoses": "[{name: LAD, vessel: lca1, start: 1.0, end: 2.0}]",
        "targets": "targets.csv",
    } | changes
    path = folder / "case.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None))
    return path
