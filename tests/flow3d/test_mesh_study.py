"""Numerical error from three meshes and half the step: known limits and orders are recovered."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core import provenance, records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.records import Record
from coronaryuq.flow3d.mesh_study import mesh_study, richardson

NODES = {"coarse": 5000, "own": 12000, "fine": 28000}


def write(folder, value, failed=()):
    """Three meshes on which quantity `name` of sample k is value(name, h, k)."""
    meshes = {}
    for name, nodes in NODES.items():
        write_json(folder / name / "mesh.json", {"nodes": nodes})
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


def study(folder, meshes, halved=None):
    """The study whose step changes nothing, unless `halved` says so."""
    return mesh_study(meshes, "own", halved or meshes["own"][1], folder / "study.json")


def test_second_order_convergence_gives_the_limit_and_its_distance(tmp_path):
    meshes = write(tmp_path, lambda q, h, k: 0.8 + 0.01 * k + 30.0 * h**2, failed={("fine", 3)})
    found = study(tmp_path, meshes)
    assert found == read_json(tmp_path / "study.json")
    assert found["meshes"] == ["coarse", "own", "fine"] and found["samples"] == ["s0", "s1", "s2"]
    assert found["checksum"] == provenance.checksum(meshes["own"][0])
    ffr = found["quantities"]["ffr_lad"]
    assert ffr["converging"] and ffr["extrapolated"] == pytest.approx(0.81)
    assert ffr["error"] == pytest.approx(1.25 * 30.0 * NODES["own"] ** (-2 / 3))
    assert ffr["order"] == pytest.approx(2.0)
    assert ffr["spread"] == pytest.approx(0.0, abs=1e-12)
    assert set(found["quantities"]) == {"ffr_lad", "osi_max_lad"}


def test_the_spread_is_the_standard_deviation_of_sample_differences(tmp_path):
    meshes = write(tmp_path, lambda q, h, k: 1.0 + k * h**2)
    found = study(tmp_path, meshes)["quantities"]["ffr_lad"]
    step = NODES["own"] ** (-2 / 3) - NODES["fine"] ** (-2 / 3)
    assert found["spread"] == pytest.approx(np.std(range(4)) * step)


def test_the_time_step_error_is_twice_the_change_from_halving_it(tmp_path):
    meshes = write(tmp_path, lambda q, h, k: 1.0 + 0.1 * k)
    halved = tmp_path / "halved_step.jsonl"
    rows = [Record(f"s{k}", {}, {"ffr_lad": 0.99 + 0.1 * k, "osi_max_lad": 1.2 + 0.1 * k}) for k in (1, 2)]
    records.write(halved, [*rows, Record.failed("s3", {}, "blew up", solver={})])
    found = study(tmp_path, meshes, halved)["quantities"]
    assert found["ffr_lad"]["step_error"] == pytest.approx(0.02)
    assert found["osi_max_lad"]["step_error"] == pytest.approx(0.4)
    records.write(halved, [Record.failed("s0", {}, "blew up", solver={})])
    with pytest.raises(InputError, match="half the time step"):
        study(tmp_path, meshes, halved)


@given(st.floats(1.05, 2.0), st.floats(-2.0, 2.0), st.floats(0.1, 5.0))
def test_any_order_between_one_and_two_is_recovered(power, limit, factor):
    size = np.array([3.0, 2.0, 1.4])
    found = richardson(size, (limit + factor * size**power).tolist(), 1)
    assert found["order"] == pytest.approx(power, rel=1e-6)
    assert found["extrapolated"] == pytest.approx(limit, abs=1e-6 * factor)
    assert found["error"] == pytest.approx(1.25 * factor * 2.0**power, rel=1e-5)


def test_an_order_above_two_is_capped():
    size = np.array([3.0, 2.0, 1.4])
    found = richardson(size, (size**4).tolist(), 1)
    assert found["order"] == pytest.approx(4.0)
    assert found["extrapolated"] < 0.0, "second order leaves more to go than the fourth, whose limit is zero"


def test_values_that_do_not_converge_get_their_range_as_error():
    size = np.array([3.0, 2.0, 1.4])
    turning = richardson(size, [1.0, 1.3, 1.1], 1)
    assert turning == {
        "values": [1.0, 1.3, 1.1], "extrapolated": None, "order": None, "converging": False,
        "error": pytest.approx(0.3),
    }  # fmt: skip
    assert richardson(size, [1.0, 1.1, 1.4], 1)["error"] == pytest.approx(0.4), "monotone, but the steps grow"
    slow = richardson(size, (size**0.5).tolist(), 1)
    assert not slow["converging"] and slow["order"] == pytest.approx(0.5)
    assert slow["error"] == pytest.approx(3.0**0.5 - 1.4**0.5)
    assert not richardson(size[:2], [1.0, 1.1], 0)["converging"], "two meshes show no order"


def test_a_study_without_common_samples_is_rejected(tmp_path):
    meshes = write(tmp_path, lambda q, h, k: 1.0, failed={("own", k) for k in range(4)})
    with pytest.raises(InputError, match="no sample was finished on every mesh"):
        study(tmp_path, meshes)
