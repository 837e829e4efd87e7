"""The mesh study: samples of the campaign on other meshes and with longer steps, and what is not measured."""

import numpy as np
import pytest

from coronaryuq.core import provenance, records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.records import Record
from coronaryuq.flow3d.mesh_study import MeshRuns, mesh_study, read_discretization

NODES = {"coarse": 5000, "own": 12000, "fine": 28000}
COST = {"cpu_s": 20.0}
STEPS = 600


def record(name, value, steps=STEPS, earlier=()):
    """A record of one quantity of interest, and of one that is none. earlier: its values in earlier cycles."""
    cycles = {"ffr_lad": list(earlier), "aortic_pressure": [9e4] * len(earlier)}
    return Record(
        name, {}, {"ffr_lad": value, "mean_flow:A:B": 1.0}, cost={"cycles": len(earlier) + 1},
        diagnostics={"steps_per_cycle": steps, "earlier_cycles": cycles},
    )  # fmt: skip


def runs(folder, name, rows):
    """Records of a mesh."""
    write_json(folder / name / "mesh.json", {"nodes": NODES[name]})
    path = folder / name / f"batch_{len(list((folder / name).iterdir()))}.jsonl"
    records.write(path, rows)
    return MeshRuns(folder / name / "mesh.json", [path])


def second_order(name, k):
    return 0.8 + 0.01 * k + 30.0 * NODES[name] ** (-2 / 3)


def three(folder, failed=()):
    """Runs of four samples on three meshes: the campaign's, and the others."""
    own, *others = (
        runs(
            folder,
            name,
            [
                Record.failed(f"s{k}", {}, "blew up") if (name, k) in failed else record(f"s{k}", second_order(name, k))
                for k in range(4)
            ],
        )
        for name in ("own", "fine", "coarse")
    )
    return own, others


def test_second_order_convergence_is_corrected_for(tmp_path):
    own, others = three(tmp_path, failed={("fine", 3)})
    written = mesh_study(own, others, None, COST, tmp_path / "study.json")
    assert written == read_json(tmp_path / "study.json")
    assert written["nodes"] == [5000, 12000, 28000] and written["cost"] == COST
    assert written["checksum"] == provenance.checksum(own.mesh)
    assert set(written["quantities"]) == {"ffr_lad"} and written["quantities"]["ffr_lad"]["unit"] == "1"
    assert written["quantities"]["ffr_lad"]["means"]["mesh"] == pytest.approx(
        [0.81 + 30.0 * nodes ** (-2 / 3) for nodes in (5000, 12000, 28000)]
    )
    (error,) = read_discretization(tmp_path / "study.json")["ffr_lad"]
    assert (error.source, error.method, error.n_samples) == ("mesh", "richardson", 3)
    assert error.correction == pytest.approx(-30.0 * 12000 ** (-2 / 3)) and error.order == pytest.approx(2.0)


def test_values_are_compared_after_the_same_number_of_cycles(tmp_path):
    _, others = three(tmp_path)
    last = [record(f"s{k}", second_order("own", k) + 0.05, earlier=[second_order("own", k)]) for k in range(4)]
    found = mesh_study(runs(tmp_path, "own", last), others, None, COST, tmp_path / "study.json")
    mesh = next(error for error in found["quantities"]["ffr_lad"]["errors"] if error["source"] == "mesh")
    assert mesh["order"] == pytest.approx(2.0), "of the first cycle; the last is 0.05 higher on one mesh"


def test_the_time_step_is_compared_where_no_sample_needed_shorter_ones(tmp_path):
    own = runs(tmp_path, "own", [record("s0", 0.80), record("s1", 0.81), record("s2", 0.5, steps=2 * STEPS)])
    longer = runs(tmp_path, "own", [record(f"s{k}", 0.82 + 0.01 * k, steps=STEPS // 2) for k in range(3)])
    found = mesh_study(own, [], longer, COST, tmp_path / "study.json")
    (error,) = read_discretization(tmp_path / "study.json")["ffr_lad"]
    assert (error.source, error.method, error.n_samples) == ("time_step", "two_levels", 2)
    assert error.std == pytest.approx(1.5 * 0.02)
    assert found["not_measured"] == {
        "mesh": "no other mesh was run",
        "cycles": "the records hold no earlier cycles",
    }


def test_the_last_cycles_of_the_campaigns_runs_give_the_error_of_their_number(tmp_path):
    rows = [record(f"s{k}", 0.8 + 0.001, earlier=[0.8 + 0.004, 0.8 + 0.002]) for k in range(3)]
    own = runs(tmp_path, "own", rows)
    mesh_study(own, [], None, COST, tmp_path / "study.json")
    (error,) = read_discretization(tmp_path / "study.json")["ffr_lad"]
    assert error.source == "cycles" and error.order == pytest.approx(1.0)
    assert error.correction == pytest.approx(-0.001)
    mesh_study(runs(tmp_path, "own", [*rows, record("s3", 0.801, earlier=[0.802])]), [], None, COST, tmp_path / "b")
    (error,) = read_discretization(tmp_path / "b")["ffr_lad"]
    assert (error.method, error.n_samples) == ("two_levels", 4)


@pytest.mark.parametrize(
    ("failed", "nodes", "reason"),
    [
        ({("own", k) for k in range(4)}, 28000, "no sample was finished on every level"),
        ((), 12000, "the meshes are equally fine"),
    ],
)
def test_a_mesh_error_that_cannot_be_measured_says_why(tmp_path, failed, nodes, reason):
    own, others = three(tmp_path, failed)
    write_json(tmp_path / "fine" / "mesh.json", {"nodes": nodes})
    found = mesh_study(own, others, None, COST, tmp_path / "study.json")
    assert reason in found["not_measured"]["mesh"] and found["quantities"] == {}


def test_longer_steps_that_all_blow_up_are_not_measured(tmp_path):
    own, _ = three(tmp_path)
    longer = runs(tmp_path, "own", [Record.failed("s0", {}, "blew up")])
    found = mesh_study(own, [], longer, COST, tmp_path / "study.json")
    assert "longer time steps" in found["not_measured"]["time_step"]


def test_a_malformed_study_is_one_line(tmp_path):
    write_json(tmp_path / "study.json", {"quantities": {"ffr_lad": {"errors": [{"source": "mesh"}]}}})
    with pytest.raises(InputError, match=r"study.json: 0.correction: missing"):
        read_discretization(tmp_path / "study.json")


def test_a_spoiled_record_is_an_error_and_not_a_missing_level(tmp_path):
    own, others = three(tmp_path)
    others[0].records[0].write_text("{}")
    with pytest.raises(InputError, match="truncated"):
        mesh_study(own, others, None, COST, tmp_path / "study.json")


def test_the_result_is_the_same_for_any_order_of_the_meshes(tmp_path):
    own, others = three(tmp_path)
    one = mesh_study(own, others, None, COST, tmp_path / "one.json")["quantities"]
    other = mesh_study(own, others[::-1], None, COST, tmp_path / "other.json")["quantities"]
    assert one == other and np.isfinite(one["ffr_lad"]["errors"][0]["std"])
