"""The coronary tree for the page: readings along every artery, and the scene that a reader can turn."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel, placed_stenoses, read_tree, throat
from coronaryuq.case.anatomy.vessel_names import readable_names
from coronaryuq.case.case_json import CaseOutlet, CaseSummary, CaseWirePlace
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.io.vtk import read_vtk
from coronaryuq.core.units import ML_PER_MIN
from coronaryuq.figures.scenes import is_wall, limit_edges, shades
from coronaryuq.figures.style import FFR_LIMIT, FFR_RANGE, colour, ffr_colours
from coronaryuq.flow3d.mesh.description import Plane

if TYPE_CHECKING:
    import pyvista

READINGS = ("ffr_low", "ffr", "ffr_high", "flow_low", "flow", "flow_high")
SPACING = 0.1
"""Largest distance between the points of a drawn centreline, cm."""


@dataclass(frozen=True)
class Readings:
    """The tree with the readings of a pressure wire: a table of vessel, position (0 to 1) and `READINGS`."""

    tree: Tree
    names: dict[str, str]
    table: pd.DataFrame

    @classmethod
    def read(cls, case: CaseSummary, tree: str | Path, pressures: str | Path) -> "Readings":
        """Read the tree and `pressures.csv`."""
        vessels = read_tree(tree)
        table = read_csv(pressures, columns=("vessel", "position", *READINGS))
        return cls(vessels, readable_names(vessels, case.outlets), table)

    def along(self, vessel: Vessel, arc: np.ndarray) -> dict[str, np.ndarray]:
        """Return the readings at arc lengths (n,) cm of a vessel; empty for one without."""
        of_vessel = self.table[self.table["vessel"] == vessel.name].sort_values("position")
        if of_vessel.empty:
            return {}
        return {name: np.interp(arc / vessel.length, of_vessel["position"], of_vessel[name]) for name in READINGS}


def pullbacks(
    readings: Readings,
    outlets: Sequence[CaseOutlet],
    stenoses: Sequence[Stenosis] = (),
    planes: Mapping[str, Plane] | None = None,
    wires: Sequence[CaseWirePlace] = (),
) -> list[dict]:
    """Return for each outlet the readings from the ostium to the end: distances in cm, flows in mL/min.

    `marks` are the lesions on the way: `name`, `start` and `end`, and `read`, where FFR is read if on the way, too.
    `wires` are the places of a pressure wire on the way: `name`, `at`, and what was measured there, with its error.
    """
    result = []
    for outlet in outlets:
        if outlet.vessel not in readings.tree:
            continue
        start, points, from_ostium = 0.0, [], {}
        for vessel in readings.tree.path(outlet.vessel):
            if vessel.branch == AORTA:
                continue
            begin = readings.tree.emergence(vessel.name)
            from_ostium[vessel.name] = start - begin
            arc = np.unique(np.concatenate([[begin], vessel.arc[vessel.arc > begin]]))
            values = readings.along(vessel, arc)
            if values:
                points += [_reading(start + a - begin, k, values) for k, a in enumerate(arc)]
            start += vessel.length - begin
        result.append(
            {
                "name": outlet.label,
                "branch": outlet.branch,
                "vessel": outlet.vessel,
                "points": points,
                "marks": [
                    _mark(s, (planes or {}).get(s.name), from_ostium) for s in stenoses if s.vessel in from_ostium
                ],
                "wires": [
                    {"name": wire.name, "at": round(wire.distance, 3), "measured": wire.measured, "sd": wire.sd}
                    for wire in wires
                    if wire.vessel in from_ostium
                ],
            }
        )
    return result


def _mark(stenosis: Stenosis, plane: Plane | None, from_ostium: Mapping[str, float]) -> dict:
    """Return a lesion on a way along vessels, with the distance (cm) from the ostium to the start of each."""
    begin = from_ostium[stenosis.vessel]
    mark = {"name": stenosis.name, "start": round(begin + stenosis.start, 3), "end": round(begin + stenosis.end, 3)}
    if plane and plane.vessel in from_ostium:
        mark["read"] = round(from_ostium[plane.vessel] + plane.arc, 3)
    return mark


def _reading(distance: float, k: int, values: Mapping[str, np.ndarray]) -> list[float]:
    flows = [round(float(values[name][k]) / ML_PER_MIN, 1) for name in READINGS[3:]]
    return [round(float(distance), 3), *(round(float(values[name][k]), 4) for name in READINGS[:3]), *flows]


def scene(readings: Readings, case: CaseSummary, planes: Mapping[str, Plane], lv: str | Path | None = None) -> str:
    """Return the scene as JSON.

    It has centrelines with radii and readings, lesions, planes of FFR, places of a wire, colours, and territories.

    Parameters
    ----------
    readings
        The tree and its readings.
    case
        The case.
    planes
        Plane of FFR by stenosis.
    lv
        Wall of the left ventricle, VTU, whose territories can be shown; None without one.
    """
    placed = placed_stenoses(case.stenoses)
    vessels = [_drawn(readings, vessel) for vessel in readings.tree]
    content = {
        "vessels": [vessel for vessel in vessels if vessel],
        "lesions": [_lesion(readings.tree, s, planes.get(s.name)) for s in placed],
        "wires": [_wire(readings.tree, wire) for wire in case.ffr_at],
        "pullbacks": pullbacks(readings, case.outlets, placed, planes, case.ffr_at),
        "range": list(FFR_RANGE), "limit": FFR_LIMIT, "colours": ffr_colours(64),
        "territories": _territories(read_vtk(lv), case.lv_outlets) if lv else None,
    }  # fmt: skip
    return json.dumps(content, separators=(",", ":"))


def _drawn(readings: Readings, vessel: Vessel) -> dict | None:
    fine = vessel.resampled(SPACING)
    values = readings.along(vessel, fine.arc * vessel.length / fine.length)
    if vessel.branch == AORTA:
        values = {}
    elif not values:
        return None
    return {
        "name": readings.names[vessel.name], "id": vessel.name, "parent": vessel.parent,
        "colour": colour(vessel.branch), "aorta": vessel.branch == AORTA,
        "points": np.round(fine.points, 3).tolist(), "radii": np.round(fine.radii, 4).tolist(),
        "edges": [
            {"points": np.round(points, 3).tolist(), "radii": np.round(radii, 4).tolist()}
            for points, radii in (limit_edges(fine, values["ffr"]) if values else [])
        ],
        "start": round(readings.tree.emergence(vessel.name), 3),
        **{name: np.round(values[name], 4).tolist() for name in values if name.startswith("ffr")},
        **{name: np.round(values[name] / ML_PER_MIN, 1).tolist() for name in values if name.startswith("flow")},
    }  # fmt: skip


def _lesion(tree: Tree, stenosis: Stenosis, plane: Plane | None) -> dict:
    arc, _ = throat(tree, stenosis)
    place = tree[stenosis.vessel].position_at(arc)
    read = {"plane": np.round(plane.point, 3).tolist(), "normal": plane.normal, "radius": plane.radius} if plane else {}
    return {"name": stenosis.name, "point": np.round(place, 3).tolist(), **read}


def _wire(tree: Tree, wire: CaseWirePlace) -> dict:
    vessel = tree[wire.vessel]
    radius = round(float(vessel.radius_at(wire.arc)), 4)
    return {"name": wire.name, "point": np.round(vessel.position_at(wire.arc), 3).tolist(), "radius": radius}


def _territories(wall: "pyvista.DataSet", outlets: Sequence[CaseOutlet]) -> dict | None:
    """Return the wall as corners (cm), triangles and the number of the outlet nearest to each; None without a map."""
    if not is_wall(wall):
        return None
    surface = wall.extract_surface(algorithm="dataset_surface").triangulate()
    faces = surface.regular_faces
    ends = np.array([outlet.point for outlet in outlets])
    centres = surface.points[faces].mean(axis=1)
    nearest = np.argmin(np.linalg.norm(centres[:, None] - ends, axis=2), axis=1)
    return {
        "points": np.round(surface.points, 2).tolist(), "faces": faces.tolist(), "outlet": nearest.tolist(),
        "names": [outlet.label for outlet in outlets], "colours": shades(list(outlets)),
    }  # fmt: skip
