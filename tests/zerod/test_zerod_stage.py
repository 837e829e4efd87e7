"""The rule function: one row per sample, however the samples are cut into chunks."""

import importlib.util
import json
import shutil

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.stage import run_chunk
from coronaryuq.zerod.svzerodsolver import choose, program
from support.case_files import write_case_json
from support.zerod_networks import bifurcation, closed_loop

LAD = {"vessel": "left", "ffr": "left:BC_left", "flow": "J0:left", "root": "J0:left", "outlet": "BC_left"}


@pytest.fixture
def inputs(tmp_path):
    random = np.random.default_rng(0)
    (tmp_path / "network.json").write_text(json.dumps(closed_loop(steps=1000)))
    outlets = [{"name": "left"}, {"name": "right", "perfuses": "RV"}]
    write_case_json(tmp_path / "case.json", outlets=outlets, stenoses=[LAD])
    columns = {name: random.uniform(0.5, 2.0, 7) for name in ("BC_left", "BC_right", "R_cor_scaling")}
    pd.DataFrame({"sample": [f"s{k}" for k in range(7)], **columns}).to_csv(tmp_path / "samples.csv", index=False)
    return tmp_path


def _chunk(folder, first, count, **settings) -> pd.DataFrame:
    paths = folder / "network.json", folder / "case.json", folder / "samples.csv"
    run_chunk(*paths, first, count, Settings(**settings), folder / "out.parquet")
    return pd.read_parquet(folder / "out.parquet")


def test_rows_do_not_depend_on_chunks_or_batches(inputs):
    whole = _chunk(inputs, 0, 7)
    parts = pd.concat([_chunk(inputs, 0, 3, batch=2), _chunk(inputs, 3, 4, batch=1)], ignore_index=True)
    pd.testing.assert_frame_equal(whole.drop(columns="cpu_s"), parts.drop(columns="cpu_s"), check_exact=True)
    assert list(whole["status"]) == ["ok"] * 7
    ratio = whole["mean_pressure:left:BC_left"] / whole["mean_pressure:J_heart_outlet:aorta"]
    assert np.array_equal(whole["ffr_lad"], ratio) and ratio.between(0.2, 1.0).all()


def test_a_failed_sample_is_a_row_without_values(inputs):
    rows = _chunk(inputs, 0, 2, periodic=True, cycles=60, tolerance=1e-15)
    assert list(rows["status"]) == ["failed", "failed"]
    assert rows["reason"].str.contains("not periodic").all() and rows["ffr_lad"].isna().all()


def test_a_bed_that_the_network_lacks_is_named(inputs):
    table = pd.read_csv(inputs / "samples.csv").rename(columns={"BC_left": "BC_lost"})
    table.to_csv(inputs / "samples.csv", index=False)
    with pytest.raises(InputError, match="BC_lost"):
        _chunk(inputs, 0, 2)


@pytest.fixture(params=["pysvzerod", "svzerodsolver"])
def theirs(request, monkeypatch):
    """svZeroDSolver as a backend, by its Python module and by its command, each where it is installed."""
    module = importlib.util.find_spec("pysvzerod") is not None
    if not (module if request.param == "pysvzerod" else shutil.which("svzerodsolver")):
        pytest.skip(f"needs {request.param}, which is not installed")
    monkeypatch.setattr(program, "installed", lambda: request.param)
    return lambda network: choose.make("svzerod", network)


def test_both_backends_give_the_same_numbers(theirs):
    network = closed_loop(steps=200, cycles=3, stenosis=0.0)
    changes, names = {"BC_left.Ra": np.array([1e4, 2e4])}, ["mean_flow:left:BC_left", "max_pressure:CLH:J_heart_outlet"]
    ours, found = (make(network).run_cycles(changes, names, cycles=3) for make in (Engine, theirs))
    assert list(found.status) == ["ok", "ok"]
    for name in names:
        # Where a valve shuts, rounding may move svZeroDSolver's own result by this much.
        assert np.allclose(ours.values[name], found.values[name], rtol=1e-3)


def test_both_backends_give_the_same_waveforms_where_no_valve_shuts(theirs):
    network, changes = bifurcation(), {"left.stenosis_coefficient": np.array([0.0, 3.0]), "RCR_right.Rd": 9e3}
    names = Engine(network).unknowns
    ours, found = (make(network).run_cycles(changes, waveforms=names, cycles=3) for make in (Engine, theirs))
    assert list(found.status) == ["ok", "ok"]
    for name in names:
        difference = np.abs(ours.waveforms[name] - found.waveforms[name]).max()
        assert difference <= 1e-8 * np.abs(found.waveforms[name]).max(), name


def test_both_backends_go_on_from_a_state(theirs):
    network, name = bifurcation(), "flow:left:RCR_left"
    start = Engine(network).run_cycles(cycles=2).state
    ours, found = (make(network).run_cycles(waveforms=[name], cycles=1, start=start) for make in (Engine, theirs))
    assert np.allclose(ours.waveforms[name], found.waveforms[name], rtol=1e-8)
