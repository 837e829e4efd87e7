"""The tree of the page: readings along arteries, territories only where there is a map."""

import json

import numpy as np
import pandas as pd
import pytest

from coronaryuq.case.anatomy.tree import Stenosis, write_tree
from coronaryuq.case.case_json import CaseOutlet, CaseWirePlace
from coronaryuq.case.perfusion.territories import wall_of_territories
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.figures.scenes import is_wall, limit_edges, territories
from coronaryuq.flow3d.mesh.description import Plane
from coronaryuq.report import tree
from support.case_files import small_tree

OUTLETS = [
    CaseOutlet(
        name=name, label=label, bc=f"BC_{name}", vessel=name, block=name, perfuses="LV", branch=branch,
        point=tuple(small_tree()[name].points[-1]), radius=0.1,
    )
    for name, label, branch in (("lca1", "LAD", "LAD"), ("lca2", "LCx", "LCx"), ("rca1", "PDA", "RCA"))
]  # fmt: skip


class Case:
    """What the page takes of a case."""

    outlets = lv_outlets = OUTLETS
    stenoses = ffr_at = ()


@pytest.fixture
def readings(tmp_path):
    """FFR falls along the LAD from 1 to 0.7 and stays 0.9 elsewhere."""
    write_tree(tmp_path / "tree.vtp", small_tree())
    ends = {"aorta": (1, 1), "branch1": (1, 1), "lca1": (1.0, 0.7), "lca2": (0.9, 0.9), "rca1": (0.9, 0.9)}
    rows = []
    for vessel, values in ends.items():
        for position, ffr in zip((0.0, 1.0), values, strict=True):
            row = {"vessel": vessel, "position": position, "flow": 1.0, "flow_low": 0.5, "flow_high": 1.5}
            rows.append(row | {"ffr": ffr, "ffr_low": ffr - 0.05, "ffr_high": ffr + 0.05})
    write_csv(tmp_path / "pressures.csv", pd.DataFrame(rows))
    return tree.Readings.read(Case, tmp_path / "tree.vtp", tmp_path / "pressures.csv")


def test_a_wire_is_read_from_the_ostium_on(readings):
    lad = next(one for one in tree.pullbacks(readings, OUTLETS) if one["name"] == "LAD")
    vessels = readings.tree
    length = vessels["branch1"].length - vessels.emergence("branch1") + vessels["lca1"].length
    distance = [point[0] for point in lad["points"]]
    assert distance[0] == 0.0 and distance[-1] == pytest.approx(length, abs=2e-3) and distance == sorted(distance)
    assert lad["points"][-1][1:] == [0.65, 0.7, 0.75, 30.0, 60.0, 90.0]


def test_the_wire_passes_its_lesions_and_the_places_where_ffr_is_read(readings):
    begin = readings.tree["branch1"].length - readings.tree.emergence("branch1")
    lesion = Stenosis("LAD", "lca1", 0.4, 0.9)
    plane = Plane(point=(0, 0, 0), normal=(1, 0, 0), radius=0.1, vessel="lca1", arc=1.2, distance_from_throat=0.5)
    found = {one["name"]: one["marks"] for one in tree.pullbacks(readings, OUTLETS, [lesion], {"LAD": plane})}
    assert found["LCx"] == found["PDA"] == []
    (mark,) = found["LAD"]
    assert [mark[key] - begin for key in ("start", "end", "read")] == pytest.approx([0.4, 0.9, 1.2], abs=2e-3)
    (without,) = tree.pullbacks(readings, OUTLETS[:1], [lesion])[0]["marks"]
    assert "read" not in without


def test_a_measured_place_of_the_wire_lies_on_its_way_and_in_the_scene(readings):
    measured = CaseWirePlace(name="distal", artery="LAD", vessel="lca1", arc=1.2, distance=3.2, measured=0.84, sd=0.02)
    trunk = CaseWirePlace(name="trunk", artery="LM", vessel="branch1", arc=2.0, distance=0.8)

    class WithWires(Case):
        ffr_at = (measured, trunk)

    scene = json.loads(tree.scene(readings, WithWires, {}))
    ways = {way["name"]: way["wires"] for way in scene["pullbacks"]}
    assert ways["LAD"][0] == {"name": "distal", "at": 3.2, "measured": 0.84, "sd": 0.02}
    assert [wire["name"] for wire in ways["LCx"]] == ["trunk"] and ways["PDA"] == []
    assert ways["LCx"][0]["measured"] is None
    vessel = readings.tree["lca1"]
    assert scene["wires"][0]["point"] == pytest.approx(vessel.position_at(1.2).tolist(), abs=1e-3)
    assert scene["wires"][0]["radius"] == pytest.approx(float(vessel.radius_at(1.2)), abs=1e-4)


def test_the_edge_lies_where_ffr_crosses_the_limit():
    vessel = small_tree()["lca1"]
    ((points, radii),) = limit_edges(vessel, np.linspace(1.0, 0.7, len(vessel.points)))
    assert points.mean(axis=0) == pytest.approx(vessel.position_at(vessel.length * 2 / 3), abs=1e-6)
    assert (radii > vessel.radius_at(vessel.length * 2 / 3)).all()
    assert limit_edges(vessel, np.full(len(vessel.points), 0.9)) == []


def test_a_patient_without_a_map_has_no_territories_and_no_empty_panel(readings, tmp_path, monkeypatch):
    wall = wall_of_territories(OUTLETS, {one.name: (1.0, 10.0) for one in OUTLETS}, 1.05, {}).mesh
    assert not is_wall(wall)
    write_vtk(tmp_path / "lv.vtu", wall)
    scene = json.loads(tree.scene(readings, Case, {}, tmp_path / "lv.vtu"))
    assert scene["territories"] is None and len(scene["vessels"]) == 6
    monkeypatch.setattr("coronaryuq.figures.scenes.read_case", lambda path: Case)
    territories("case.json", str(tmp_path / "lv.vtu"), str(tmp_path / "tree.vtp"), str(tmp_path / "t.png"))
    import matplotlib.image

    picture = matplotlib.image.imread(tmp_path / "t.png")
    half = picture.shape[1] // 2
    assert (picture[:, :half, :3] < 0.9).any(axis=2).mean() > 0.01 < (picture[:, half:, :3] < 0.9).any(axis=2).mean()
