"""The job of the mesh study: what it reads of the campaign, and what it has cost."""

import pytest

from coronaryuq.campaign.jobs.mesh_study import compare_levels
from coronaryuq.core import records
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.records import Record
from coronaryuq.flow3d.mesh_study import read_discretization

RUNS = 4


def level(folder, nodes, ffr, steps=400):
    """A mesh, records of four runs, and costs of 10 CPU s for the mesh and 5 per run."""
    write_json(folder / "mesh.json", {"nodes": nodes})
    rows = [
        Record(f"s{k}", {}, {"ffr_lad": ffr}, cost={"cycles": 2}, diagnostics={"steps_per_cycle": steps})
        for k in range(RUNS)
    ]
    records.write(folder / "batch_0.jsonl", rows)
    write_json(folder / "mesh_cost.json", {"cpu_s": 10.0})
    write_json(folder / "cost.json", {"cpu_s": 5.0 * RUNS})
    return [str(folder / name) for name in ("mesh.json", "batch_0.jsonl", "mesh_cost.json", "cost.json")]


def test_errors_and_cost_of_a_study_with_two_meshes_and_two_steps(tmp_path):
    mesh, batch, _, cost = level(tmp_path / "own", 8000, 0.80)
    coarse = level(tmp_path / "coarse", 1000, 0.83)
    longer = level(tmp_path / "longer", 8000, 0.81, steps=200)
    out = tmp_path / "mesh_study.json"
    compare_levels(
        mesh, [batch], [cost], [coarse[0]], [coarse[1]], [longer[1]], [coarse[2], coarse[3], longer[3]], 64, str(out)
    )
    assert read_json(out)["cost"] == {
        "cpu_s": 50.0, "cpu_s_per_3d_run": 5.0, "fraction_of_3d": pytest.approx(50 / (64 * 5)),
    }  # fmt: skip
    by_source = {error.source: error for error in read_discretization(out)["ffr_lad"]}
    assert by_source["mesh"].std == pytest.approx(1.5 * 0.03 / (4 - 1)), "elements twice as long, second order"
    assert by_source["time_step"].std == pytest.approx(1.5 * 0.01)
    assert "cycles" in read_json(out)["not_measured"]
