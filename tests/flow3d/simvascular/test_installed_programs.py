"""The SimVascular programs themselves on a coarse tube; skipped, with the reason, where they are not installed.

Wanted on the PATH: svmultiphysics; svpre, svsolver, svpost. SVZEROD_INTERFACE: path of svZeroDSolver's library.
SIMVASCULAR_MPI: the MPI launcher that fits them (default mpiexec).
"""

import os
import shutil
from dataclasses import replace

import pytest

from coronaryuq.flow3d.adapter import Sample
from coronaryuq.flow3d.simvascular.program import RunFailed, execute
from coronaryuq.flow3d.simvascular.svmultiphysics import SvMultiPhysics
from coronaryuq.flow3d.simvascular.svsolver import SvSolver
from support.sv_case import make_case

SAMPLE = Sample("s1", 0, {"R_cor_scaling": 1.0})


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    library = os.environ.get("SVZEROD_INTERFACE", "")
    if not os.path.isabs(library) or not os.path.isfile(library):
        pytest.skip("SVZEROD_INTERFACE does not name svZeroDSolver's libsvzero_interface.so")
    return make_case(
        tmp_path_factory.mktemp("case"),
        zerod_library=library,
        mpi=os.environ.get("SIMVASCULAR_MPI", "mpiexec"),
        steps_per_cycle=100,
        frames_per_cycle=50,
    )


def need(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not on the PATH")


def trial(case, backend, tmp_path):
    """A few steps: every program starts, steps and writes; a whole cycle is a test of its own."""
    few = replace(case, settings=case.settings.model_copy(update={"stop_after": 4}))
    solver = backend(few)
    run = tmp_path / "run"
    solver.prepare(SAMPLE, run)
    for line in solver.commands():
        execute(line, run, 300.0)
    assert len((run / "svZeroD_data").read_text().splitlines()) == 1 + 4
    with pytest.raises(RunFailed, match="stopped after 4 of 100 steps"):
        solver.collect(run, SAMPLE)
    return run


def test_svmultiphysics_takes_the_deck(case, tmp_path):
    need("svmultiphysics")
    run = trial(case, SvMultiPhysics, tmp_path)
    assert (run / "1-procs" / "result_004.vtu").is_file()


def test_svsolver_takes_the_deck(case, tmp_path):
    need("svpre", "svsolver", "svpost")
    run = trial(case, SvSolver, tmp_path)
    assert (run / "all_results.vtu").is_file()


@pytest.mark.long
@pytest.mark.parametrize(
    ("backend", "programs"), [(SvMultiPhysics, ["svmultiphysics"]), (SvSolver, ["svpre", "svsolver", "svpost"])]
)
def test_a_whole_cycle_conserves_mass_and_loses_pressure(case, backend, programs, tmp_path):
    need(*programs)
    settings = case.settings.model_copy(update={"time_limit": 3000.0})
    record = backend(replace(case, settings=settings)).run_sample(SAMPLE, tmp_path / "run")
    assert record.ok, record.reason
    values = record.outputs
    inflow, outflow = values["mean_flow:LAD_seg0:inlet_LAD"], values["mean_flow:outlet_LAD:LAD"]
    assert outflow == pytest.approx(inflow, rel=5e-3)
    assert 0.3 < values["ffr_lad"] < 1.0
    assert 0.0 < values["tawss_min_lad"] < values["tawss_mean_lad"]
    assert 0.0 <= values["osi_max_lad"] <= 0.5
