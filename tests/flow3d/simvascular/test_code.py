"""A run that gives no result says why in one line of its record."""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.units import MMHG
from coronaryuq.flow3d.adapter import Outputs, Processes, Sample
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.simvascular import coupled_case, svsolver
from coronaryuq.flow3d.simvascular.program import RunFailed, execute
from coronaryuq.flow3d.simvascular.svmultiphysics import SvMultiPhysics
from coronaryuq.flow3d.simvascular.svsolver import SvSolver
from coronaryuq.flow3d.stage import run_batch
from support.sv_case import batch_of, make_case

pytestmark = pytest.mark.slow

SAMPLE = Sample("s1", 0, {"R_cor_scaling": 1.0})


@pytest.fixture(scope="session")
def case(tmp_path_factory):
    return make_case(tmp_path_factory.mktemp("case"), steps_per_cycle=20, frames_per_cycle=20)


def shell(script: str, limit: float = 20.0):
    return lambda run: execute(["sh", "-c", script], run, limit)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (shell("kill -9 $$"), r"sh was killed \(SIGKILL\)"),
        (shell("exit 137"), r"sh was killed \(SIGKILL\)"),
        (shell("sleep 30", limit=0.5), "sh ran out of time after 0 s"),
        (shell("echo step 1; echo 'ERROR: no mesh'; echo bye; exit 3"), "sh failed with code 3: ERROR: no mesh"),
        (shell("exit 3"), r"sh failed with code 3: \(no output in its log\)"),
        (lambda run: execute(["no-such-program"], run, 1.0), "no-such-program cannot be started"),
    ],
)
def test_failures_of_programs_are_reported(action, message, tmp_path):
    with pytest.raises(RunFailed, match=message):
        action(tmp_path)


def test_a_timeout_kills_the_children_of_a_program(tmp_path):
    with pytest.raises(RunFailed, match="out of time"):
        execute(["sh", "-c", "sleep 60 & echo $! > child; wait"], tmp_path, 1.0)
    child = int((tmp_path / "child").read_text())
    stat = Path(f"/proc/{child}/stat")
    # A killed process is gone only when it is next scheduled.
    for _ in range(100):
        try:
            if stat.read_text().split()[2] == "Z":
                return
        except (FileNotFoundError, ProcessLookupError):
            return
        time.sleep(0.1)
    pytest.fail("the child outlived the program by ten seconds")


def test_a_missing_program_gives_a_failed_record(case, tmp_path):
    settings = case.settings.model_copy(update={"svpre": "no-such-svpre"})
    record = SvSolver(replace(case, settings=settings)).run_sample(SAMPLE, tmp_path / "run")
    assert not record.ok
    assert "no-such-svpre cannot be started" in record.reason
    assert record.inputs == {"R_cor_scaling": 1.0}
    assert record.cost["wall_s"] > 0.0


def test_a_sample_without_a_periodic_state_gives_a_failed_record(case, tmp_path):
    network = case.network.deep_copy()
    network["closed_loop_blocks"][0]["parameters"]["Elv_s"] = -1e9
    record = SvSolver(replace(case, network=network)).run_sample(SAMPLE, tmp_path / "run")
    assert not record.ok
    assert record.reason.startswith("0D start")


def test_a_trial_that_stops_early_gives_no_result(case, tmp_path):
    early = replace(case, settings=case.settings.model_copy(update={"stop_after": 5}))
    with pytest.raises(RunFailed, match="stopped after 5 of 20 steps"):
        early.frames()


@pytest.fixture
def finished(case, tmp_path):
    """What svMultiPhysics leaves, written here with constant shear and linear pressure: the answers are known."""
    run = tmp_path / "run"
    SvMultiPhysics(case).prepare(SAMPLE, run)
    (run / "4-procs").mkdir()
    points = case.domain.points
    order = np.arange(len(points))[::-1]
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: np.argsort(order)[case.domain.tets]}, points[order])
    for step in case.frames():
        grid.point_data["Pressure"] = 1e5 - 1e3 * points[order, 1]
        sign = 1.0 if step <= 15 else -1.0
        grid.point_data["WSS"] = sign * np.tile([0.0, 8.0, 0.0], (len(points), 1))
        grid.save(run / "4-procs" / f"result_{step:03d}.vtu")
    names = [f"{kind}:{place}" for place in case.coupled.place.values() for kind in ("flow", "pressure")]
    names += ["pressure:LAD:BC_LAD", case.aortic_pressure]
    rows = [f"{k / 20} 1.0 9e4 1.5 8e4 7.7e4 1.1e5" for k in range(20)]
    write_text(run / "svZeroD_data", "\n".join([f"{len(names)} {' '.join(names)}", *rows]) + "\n")
    return run


def test_quantities_of_interest_agree_with_the_fields(case, finished):
    record = SvMultiPhysics(case).collect(finished, SAMPLE)
    values = record.outputs
    plane, before = case.domain.planes["LAD"][0], case.domain.proximal_planes["LAD"][0]
    assert values["ffr_lad"] == pytest.approx((1e5 - 1e3 * plane[1]) / 1.1e5, rel=1e-6)
    assert values["pressure_drop_lad"] == pytest.approx(1e3 * (plane[1] - before[1]) / MMHG, rel=1e-6)
    assert before[1] == pytest.approx(1.1, abs=1e-3) and values["lowest_ffr_lad"] == pytest.approx(0.7)
    assert values["tawss_min_lad"] == pytest.approx(8.0)
    assert values["osi_max_lad"] == pytest.approx(0.5 * (1.0 - 10.0 / 20.0))
    assert values["mean_flow:LAD_seg0:inlet_LAD"] == 1.0
    assert values["mean_pressure:outlet_LAD:LAD"] == 8e4
    assert record.solver["name"] == "svmultiphysics"


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda run: (run / "4-procs" / "result_020.vtu").unlink(), "result_020.vtu is missing"),
        (
            lambda run: os.truncate(run / "4-procs" / "result_007.vtu", 3000),
            "result_007.vtu: empty or truncated",
        ),
        (lambda run: (run / "svZeroD_data").unlink(), "svZeroD_data is missing"),
        (lambda run: os.truncate(run / "svZeroD_data", 300), "svZeroD_data is truncated"),
        (lambda run: (run / "4-procs").rename(run / "elsewhere"), "never started stepping"),
        (lambda run: _spoil(run / "4-procs" / "result_003.vtu"), "not finite"),
    ],
)
def test_broken_output_is_reported(case, finished, harm, message):
    harm(finished)
    with pytest.raises(RunFailed, match=message):
        SvMultiPhysics(case).collect(finished, SAMPLE)


def _spoil(path):
    grid = pv.read(path)
    grid.point_data["WSS"][0] = np.nan
    grid.save(path)


def test_svsolver_reads_what_svpost_combines(case, tmp_path):
    run = tmp_path / "run"
    SvSolver(case).prepare(SAMPLE, run)
    points = case.domain.points
    volume = pv.read(run / coupled_case.INITIAL)
    volume.clear_data()
    volume.point_data["GlobalNodeID"] = np.arange(1, len(points) + 1)
    wall = pv.read(run / "mesh-complete" / "walls_combined.vtp")
    for step in case.frames():
        volume.point_data[f"pressure_{step:05d}"] = 1e5 - 1e3 * points[:, 1]
        wall.point_data[f"vWSS_{step:05d}"] = np.tile([0.0, 8.0, 0.0], (wall.n_points, 1))
    volume.save(run / svsolver.ALL_VTU)
    wall.save(run / svsolver.ALL_VTP)
    names = [f"{kind}:{place}" for place in case.coupled.place.values() for kind in ("flow", "pressure")]
    names += ["pressure:LAD:BC_LAD", case.aortic_pressure]
    rows = [f"{k / 20} 1.0 9e4 1.5 8e4 7.7e4 1.1e5" for k in range(20)]
    (run / "2-procs_case").mkdir()
    write_text(run / "2-procs_case" / "svZeroD_data", "\n".join([f"{len(names)} {' '.join(names)}", *rows]) + "\n")
    values = SvSolver(case).collect(run, SAMPLE).outputs
    plane, before = case.domain.planes["LAD"][0], case.domain.proximal_planes["LAD"][0]
    assert values["ffr_lad"] == pytest.approx((1e5 - 1e3 * plane[1]) / 1.1e5, rel=1e-6)
    assert values["pressure_drop_lad"] == pytest.approx(1e3 * (plane[1] - before[1]) / MMHG, rel=1e-6)
    assert before[1] == pytest.approx(1.1, abs=1e-3) and values["lowest_ffr_lad"] == pytest.approx(0.7)
    assert values["tawss_min_lad"] == pytest.approx(8.0)
    assert values["osi_max_lad"] == pytest.approx(0.0, abs=1e-12)


def test_failed_samples_do_not_stop_the_batch(case, tmp_path):
    write_text(tmp_path / "samples.csv", "sample,BC_LAD,R_cor_scaling\na,1.0,1.0\nb,1.1,0.9\n")
    settings = Settings(simvascular=case.settings.model_copy(update={"svmultiphysics": "false"}))
    batch = batch_of(case.mesh_folder.parents[1], tmp_path / "samples.csv", 2)
    outputs = Outputs(tmp_path / "batch_0.jsonl", tmp_path / "work")
    run_batch(batch, "svmultiphysics", settings, outputs, Processes(mpi=f"{sys.executable} -c pass"))
    rows = records.read(outputs.records)
    assert [row.sample for row in rows] == ["a", "b"]
    assert not any(row.ok for row in rows)
    assert all("never started stepping" in row.reason for row in rows)


def test_an_unknown_solver_or_bed_is_rejected(case, tmp_path):
    outputs = Outputs(tmp_path / "out.jsonl", tmp_path / "work")
    write_text(tmp_path / "samples.csv", "sample,BC_LAD\na,1.0\n")
    batch = batch_of(case.mesh_folder.parents[1], tmp_path / "samples.csv", 1)
    with pytest.raises(InputError, match="backend"):
        run_batch(batch, "fluent", Settings(), outputs)
    write_text(tmp_path / "samples.csv", "sample,BC_x\na,1.0\n")
    with pytest.raises(InputError, match="BC_x"):
        run_batch(batch, "svsolver", Settings(), outputs)
