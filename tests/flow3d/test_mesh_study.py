"""Mesh error from three meshes: known limits come back, and what does not converge is given its whole range."""

import numpy as np
import pytest

from coronaryuq import files, records
from coronaryuq.errors import InputError
from coronaryuq.flow3d.mesh_study import mesh_study, richardson
from coronaryuq.records import Record

NODES = {"coarse": 5000, "own": 12000, "fine": 28000}


def write(folder, value, failed=()):
    """Three meshes on which quantity `name` of sample k is value(name, h, k)."""
    meshes = {}
    for name, nodes in NODES.items():
        files.write_json(folder / name / "mesh.json", {"nodes": nodes})
        rows = [
            Record.failed(f"s{k}", {}, "blew up", solver={})
            if (name, k) in failed
            else Record(
                f"s{k}", {}, {q: value(q, nodes ** (-1 / 3), k) for q in ("ffr_lad", "osi_max_lad", "mean_flow:A:B")}
            )
            for k in range(4)
        ]
        records.write(folder / name / "batch.jsonl", rows)
        meshes[name] = (folder / name / "mesh.json", folder / name / "batch.jsonl")
    return meshes


def test_second_order_convergence_gives_the_limit_and_its_distance(tmp_path):
    meshes = write(tmp_path, lambda q, h, k: 0.8 + 0.01 * k + 30.0 * h**2, failed={("fine", 3)})
    found = mesh_study(meshes, "own", tmp_path / "study.json")
    assert found == files.read_json(tmp_path / "study.json")
    assert found["meshes"] == ["coarse", "own", "fine"] and found["samples"] == ["s0", "s1", "s2"]
    ffr = found["quantities"]["ffr_lad"]
    assert ffr["extrapolated"] == pytest.approx(0.81)
    assert ffr["error"] == pytest.approx(30.0 * NODES["own"] ** (-2 / 3))
    assert ffr["order"] == pytest.approx(2.0)
    assert set(found["quantities"]) == {"ffr_lad", "osi_max_lad"}


def test_values_that_turn_round_are_given_their_range():
    size = np.array([3.0, 2.0, 1.4])
    assert richardson(size, [1.0, 1.3, 1.1], 1) == {
        "values": [1.0, 1.3, 1.1], "extrapolated": None, "order": None, "error": pytest.approx(0.3),
    }  # fmt: skip
    assert richardson(size, [1.0, 1.1, 1.4], 1)["error"] == pytest.approx(0.4), "monotone, but the steps grow"


def test_no_common_sample_is_refused(tmp_path):
    meshes = write(tmp_path, lambda q, h, k: 1.0, failed={("own", k) for k in range(4)})
    with pytest.raises(InputError, match="no sample was finished on every mesh"):
        mesh_study(meshes, "own", tmp_path / "study.json")
