"""Vessels, a small case on disk, and the JSON files that later stages read of a case."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, Vessel, write_tree
from coronaryuq.case.case_json import CaseSummary
from coronaryuq.cli.check import check
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json


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


def add_measurements(case_yaml: Path) -> None:
    """Add a pressure at rest and under hyperaemia to a case of `small_tree`."""
    (case_yaml.parent / "measured.csv").write_text(
        "condition,quantity,location,statistic,time,value,sd,unit\n"
        "rest,pressure,lca1:BC_lca1,mean,,88,1.5,mmHg\n"
        "stress,pressure,lca1:BC_lca1,mean,,80,1.5,mmHg\n"
    )
    (case_yaml.parent / "conditions.yaml").write_text(
        "rest:\nstress: {coronary_resistance_scale: 0.24, held_out: true}\n"
    )
    with case_yaml.open("a") as file:
        file.write("measurements: {file: measured.csv, conditions: conditions.yaml}\n")


CLINICAL = {
    "cuff": (
        "pressure,J_heart_outlet:aorta,max,,{cuff_max},5,mmHg",
        "pressure,J_heart_outlet:aorta,min,,{cuff_min},5,mmHg",
    ),
    "phase-contrast": ("flow,J_heart_outlet:aorta,mean,,{output},0.3,L/min", "flow,J0:rca1,mean,,{rca},4,mL/min"),
    "Doppler": ("flow,lca1:BC_lca1,mean,,{lca},4,mL/min",),
    "perfusion": ("perfusion,BC_lca1,mean,,{mbf},0.1,mL/min/g", "perfusion,BC_lca2,mean,,{mbf},0.1,mL/min/g"),
}
"""What a clinic measures at rest and under stress in a case of `small_tree`: rows of a table without the condition."""
PULLED = "branch1_seg0>lca1"
"""Path of a pullback in a case of `small_tree`, 6 cm long."""


def clinical_table(conditions: Iterable[str] = ("rest", "stress"), **values: float) -> str:
    """Return a table of all that `CLINICAL` lists in each condition, and of a pullback under stress."""
    defaults = {"cuff_max": 120, "cuff_min": 75, "output": 4.7, "rca": 40, "lca": 60, "mbf": 0.9} | values
    lines = ["condition,quantity,location,statistic,time,value,sd,unit,distance,distance_unit"]
    lines += [f"{name},{row.format(**defaults)},," for name in conditions for rows in CLINICAL.values() for row in rows]
    lines += [f"stress,ratio,{PULLED},mean,,{0.95 - x / 500},0.02,1,{x},mm" for x in (60, 40, 20, 0)]
    return "\n".join([*lines, f"stress,drift,{PULLED},mean,,1.0,0.5,mmHg,,"]) + "\n"


def outlet(name: str = "lca1", **values) -> dict:
    """An outlet of `case.json`; `values` replace its defaults."""
    return {
        "name": name, "label": name, "bc": f"BC_{name}", "vessel": name, "block": name, "perfuses": "LV",
        "branch": "LAD", "point": [0.0, 0.0, 0.0], "radius": 0.1,
    } | values  # fmt: skip


def stenosis(name: str = "LAD", **values) -> dict:
    """A stenosis of `case.json`; `values` replace its defaults."""
    return {
        "name": name, "artery": name, "vessel": "lca1", "segment": "lca1", "proximal": None, "distal": None,
        "area_ratio": 0.4, "start": 1.0, "end": 2.0, "ffr": "lca1:BC_lca1", "flow": "J0:lca1", "root": "J0:lca1",
        "outlet": "BC_lca1",
    } | values  # fmt: skip


def case_content(outlets: Iterable[Mapping] = ({},), stenoses: Iterable[Mapping] = (), **values) -> dict:
    """The content of a whole `case.json`; whatever is left out has a default."""
    return {
        "name": "small", "description": "", "period": 1.0, "density": 1.06, "viscosity": 0.04, "haematocrit": None,
        "hyperaemia": 0.24, "tissue_density": 1.05, "schematic": False,
        "anatomy": {"kind": "centrelines", "unit": "cm"}, "aorta": {"pressure": "J_heart_outlet:aorta"},
        "outlets": [outlet(**entry) for entry in outlets], "systemic": ["BC_RCR1"],
        "stenoses": [stenosis(**entry) for entry in stenoses], "targets": {}, "notes": [],
    } | values  # fmt: skip


def case_summary(**values) -> CaseSummary:
    return CaseSummary.model_validate(case_content(**values))


def write_case_json(path: Path, **values) -> Path:
    write_json(path, case_content(**values))
    return path


def write_perfusion_targets(path: Path, bc: list[str], mean: np.ndarray, covariance=None, **values) -> Path:
    """A `targets.json` of the perfusion stage; the covariance is 10 % of each flow, independent, if left out."""
    mean = np.asarray(mean, dtype=float)
    content = {
        "outlets": [name.removeprefix("BC_") for name in bc], "bc": bc, "mean": mean,
        "covariance": np.diag((0.1 * mean) ** 2) if covariance is None else covariance,
        "baseline": mean, "use": "independent", "branch_sd": None, "relative_sd": np.full(len(bc), 0.1),
        "volume": np.full(len(bc), 10.0), "realisations": 10, "models": {},
        "lv": {"volume": 100.0, "mass": 105.0, "tissue_density": 1.05, "flow": mean.sum(), "points": 10},
        "provenance": {},
    }  # fmt: skip
    write_json(path, content | values)
    return path


def check_case(path: Path) -> tuple[list[str], list[str]]:
    """Faults of a case and what it contains, as `coronaryuq check` prints them."""
    try:
        found = check(path)
    except InputError as error:
        return [str(error)], []
    return ([] if found.error is None else [str(found.error)]), found.lines
