"""Benchmark of the 3D solver: its fixed keys, and mesh convergence on quantities with a known limit."""

import pytest

from coronaryuq.bench.flow3d.benchmark import convergence, cost
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.records import Record

QUANTITIES = ("ffr", "tawss_min", "osi_max")


@pytest.fixture
def meshes(tmp_path):
    """Three meshes whose quantities are 1 + h² (samples differ by a factor)."""
    for name, nodes in (("a", 1000), ("b", 8000), ("c", 64000)):
        error = 10.0 * nodes ** (-2 / 3)
        rows = [
            Record(f"s{k}", {}, {f"{quantity}_lad": (1 + error) * (1 + 0.1 * k) for quantity in QUANTITIES})
            for k in range(3)
        ]
        rows.append(Record.failed("s9", {}, "blew up"))
        records.write(tmp_path / name / "batch_0.jsonl", rows)
        write_json(tmp_path / name / "mesh.json", {"nodes": nodes})
    return tmp_path


def test_extrapolation_recovers_the_limit(meshes):
    rows = convergence(meshes)
    assert {row["quantity"] for row in rows} == set(QUANTITIES)
    for row in rows:
        assert row["nodes"] == [1000, 8000, 64000]
        assert row["means"][1] + row["correction"] == pytest.approx(1.1)
        assert row["method"] == "richardson" and row["order"] == pytest.approx(2.0)
        assert row["n_samples"] == 3


def test_convergence_needs_two_meshes(meshes):
    for name in ("a", "b"):
        (meshes / name / "mesh.json").unlink()
    with pytest.raises(InputError, match="two or three"):
        convergence(meshes)


def test_cost_has_the_fixed_keys():
    found = cost(3, 10, 1)
    keys = {"nodes", "tets", "samples", "steps_per_cycle", "cpu_s_per_sample_cycle", "peak_rss_mb"}
    assert keys <= set(found)
    assert found["cpu_s_per_sample_cycle"] > 0
